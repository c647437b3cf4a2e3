"""From rows to points: which rows a point is decoded from, of which kind it is, what replies say."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

from gateway.families import TYPE_LIMITS, Profile, Type, Variant, decode, once_per_profile, reading

TEXT_TYPES = tuple(kind for kind in Type if kind not in TYPE_LIMITS)
ENUM_TYPES = (Type.ENUM, Type.LOW_ENUM)

_MOST_CACHED = 64

Rows = Mapping[str, tuple[int, ...]]  # raw words by code


class DecodedPoints(NamedTuple):
    """The points that were decoded from rows, and those for which a row was missing."""

    points: Mapping[str, decode.Decoded]
    missing: tuple[str, ...]


class PointSources:
    """Which rows each point of a family is decoded from."""

    def __init__(self, profile: Profile) -> None:
        self._profile = profile
        self._codes_of = {
            name: frozenset(reading.rows_of_points(profile, (name,))) for name in profile.points
        }
        self._fed_by = lru_cache(_MOST_CACHED)(self._find_fed)  # the same few blocks come again

    def fed_by(self, codes: Iterable[str]) -> tuple[str, ...]:
        """Return the points that depend on one of these rows."""
        return self._fed_by(frozenset(codes))

    def _find_fed(self, codes: frozenset[str]) -> tuple[str, ...]:
        return tuple(name for name, sources in self._codes_of.items() if not codes.isdisjoint(sources))

    def are_enough(self, rows: Rows) -> bool:
        """Return whether the points that these rows feed depend on no others."""
        return all(self._codes_of[name] <= rows.keys() for name in self.fed_by(rows))

    def decode(self, variant: Variant, rows: Rows, *, known: Rows) -> DecodedPoints:
        """Return the points that depend on freshly read rows, decoded from these and from `known` ones."""
        fed = self.fed_by(rows)
        others = {code: known[code] for name in fed for code in self._codes_of[name] if code in known}
        decoded = decode.decode_points(self._profile, variant, {**others, **rows}, names=fed)
        missing = tuple(name for name in fed if name not in decoded)
        return DecodedPoints({name: decoded[name] for name in fed if name in decoded}, missing)


@once_per_profile
def sources_of(profile: Profile) -> PointSources:
    """Return the sources of a family's points, the same ones for all its starters."""
    return PointSources(profile)


class Answer(NamedTuple):
    """Raw words by code, and what they say; None when that depends on other rows too."""

    rows: Rows
    decoded: DecodedPoints | None


class AnswerCache:
    """Reads the answers of one starter; most say the same as the last one to the same poll."""

    def __init__(self, profile: Profile) -> None:
        self._profile = profile
        self._sources = sources_of(profile)
        self._latest: dict[
            str, tuple[reading.Block, Variant, Sequence[Any], Answer]
        ] = {}  # by the poll's key

    def read(self, key: str, block: reading.Block, variant: Variant, value: Sequence[Any]) -> Answer:
        """Return what an answer says."""
        latest = self._latest.get(key)
        if latest is not None and latest[0] is block and latest[1] is variant and latest[2] == value:
            return latest[3]
        rows = block.rows_in(self._profile, value)
        is_enough = self._sources.are_enough(rows)
        answer = Answer(rows, self._sources.decode(variant, rows, known={}) if is_enough else None)
        self._latest[key] = block, variant, value, answer
        return answer


def is_flag(profile: Profile, name: str) -> bool:
    """Return whether a point is a boolean."""
    point = profile.points[name]
    if point.bit is not None or point.true_when or point.none_of:
        return True
    return profile.parameters[point.code].type is Type.BIT


def unit_of(profile: Profile, name: str) -> str:
    """Return the unit of a point's value; empty for booleans and plain numbers."""
    return "" if is_flag(profile, name) else profile.parameters[profile.points[name].code].unit


@once_per_profile
def units_of(profile: Profile) -> Mapping[str, str]:
    """Return the unit of each point."""
    return {name: unit_of(profile, name) for name in profile.points}


@once_per_profile
def deadbands_of(profile: Profile) -> Mapping[str, float]:
    """Return the deadband of each point, in its unit."""
    return {name: point.deadband for name, point in profile.points.items()}


@once_per_profile
def flags_of(profile: Profile) -> tuple[str, ...]:
    """Return the booleans of the state: those of the family, not what a site asks for besides."""
    return tuple(name for name in profile.family_points if is_flag(profile, name))


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
