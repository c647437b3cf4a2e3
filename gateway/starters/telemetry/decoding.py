"""From rows to points: which points a row feeds, and what freshly read rows say about them.

What the answers to one starter's polls say; most say what they said before, and are not decoded again.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from gateway.families.mapped_registers import rows_from
from gateway.families.profile.decode import Decoded, decode_points
from gateway.families.profile.schema import Profile, Type, Variant
from gateway.families.profile.word_types import TYPE_LIMITS
from gateway.families.reading.bulk import rows_of_points
from gateway.families.reading.poll_blocks import Block

TEXT_TYPES = tuple(kind for kind in Type if kind not in TYPE_LIMITS)
ENUM_TYPES = (Type.ENUM, Type.LOW_ENUM)

_MOST_KEPT = 64


class PointSources:
    """Which rows each point of a family is told from."""

    def __init__(self, profile: Profile) -> None:
        self._profile = profile
        self._fed_by: dict[frozenset[str], tuple[str, ...]] = {}  # the same few blocks come again
        self._codes_of = {name: frozenset(rows_of_points(profile, (name,))) for name in profile.points}

    def fed_by(self, codes: Iterable[str]) -> tuple[str, ...]:
        """Return the points that depend on one of these rows."""
        wanted = frozenset(codes)
        fed = self._fed_by.get(wanted)
        if fed is None:
            if len(self._fed_by) >= _MOST_KEPT:
                self._fed_by.clear()
            fed = tuple(name for name, sources in self._codes_of.items() if not wanted.isdisjoint(sources))
            self._fed_by[wanted] = fed
        return fed

    def are_enough(self, rows: Mapping[str, tuple[int, ...]]) -> bool:
        """Return whether the points that these rows feed depend on no others."""
        return all(self._codes_of[name] <= rows.keys() for name in self.fed_by(rows))

    def tell(
        self, variant: Variant, rows: Mapping[str, tuple[int, ...]], *, known: Mapping[str, tuple[int, ...]]
    ) -> tuple[dict[str, Decoded], tuple[str, ...]]:
        """Return the points that freshly read rows tell, beside `known` ones, and those they fail to tell."""
        fed = self.fed_by(rows)
        others = {code: known[code] for name in fed for code in self._codes_of[name] if code in known}
        decoded = decode_points(self._profile, variant, {**others, **rows}, names=fed)
        told = {name: decoded[name] for name in fed if name in decoded}
        return told, tuple(name for name in fed if name not in decoded)


def is_flag(profile: Profile, name: str) -> bool:
    """Return whether a point is a boolean."""
    point = profile.points[name]
    if point.bit is not None or point.true_when or point.none_of:
        return True
    return profile.parameters[point.code].type is Type.BIT


def unit_of(profile: Profile, name: str) -> str:
    """Return the unit of a point's value; empty for booleans and plain numbers."""
    return "" if is_flag(profile, name) else profile.parameters[profile.points[name].code].unit


def type_of(profile: Profile, name: str) -> str:
    """Return the kind of a point's value: boolean, enum, string, float or integer."""
    if is_flag(profile, name):
        return "boolean"
    row = profile.parameters[profile.points[name].code]
    if row.type in ENUM_TYPES:
        return "enum"
    if row.type in TEXT_TYPES:
        return "string"
    return "float" if row.decimals or row.unit else "integer"


@dataclass(frozen=True, slots=True)
class Told:
    """The points that rows tell, and those that they fail to tell."""

    points: Mapping[str, Decoded]
    untold: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Answer:
    """Raw words by code, and what they say; None when that depends on other rows too."""

    rows: Mapping[str, tuple[int, ...]]
    told: Told | None


@dataclass(frozen=True, slots=True)
class _Memory:
    block: Block
    variant: Variant
    value: Sequence[Any]
    answer: Answer


class AnswerCache:
    """Reads the answers of one starter, poll by poll."""

    def __init__(self, profile: Profile, sources: PointSources) -> None:
        self._profile = profile
        self._sources = sources
        self._memories: dict[str, _Memory] = {}  # by the poll's key

    def read(self, key: str, block: Block, variant: Variant, value: Sequence[Any]) -> Answer | None:
        """Return what an answer says; None when the mapped words are not ours any more."""
        known = self._memories.get(key)
        if known and known.block is block and known.variant is variant and known.value == value:
            return known.answer
        rows = rows_from(self._profile, block, value)
        if rows is None:
            return None
        told = Told(*self._sources.tell(variant, rows, known={})) if self._sources.are_enough(rows) else None
        answer = Answer(rows, told)
        self._memories[key] = _Memory(block, variant, value, answer)
        return answer
