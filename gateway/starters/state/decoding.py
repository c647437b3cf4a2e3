"""From rows to points: which rows a point is decoded from, of which kind it is, what replies say."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

from gateway.contract import Quality
from gateway.families import TYPE_LIMITS, Profile, Type, Variant, decode, once_per_profile, reading
from gateway.starters.state.readings import Points, Reading, Value, good_values

TEXT_TYPES = tuple(kind for kind in Type if kind not in TYPE_LIMITS)
ENUM_TYPES = (Type.ENUM, Type.LOW_ENUM)

_MOST_CACHED = 64

Rows = Mapping[str, tuple[int, ...]]  # raw words by code
NO_ROWS: Rows = {}


class Said(NamedTuple):
    """What a reply says."""

    rows: Rows
    points: Points
    missing: tuple[str, ...] = ()  # points for which a row is missing
    values: Mapping[str, Value] = {}  # the good ones of `points`


def said(rows: Rows, points: Points, missing: tuple[str, ...] = ()) -> Said:
    """Return what these rows and points say."""
    return Said(rows, points, missing, good_values(points))


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

    def decode(
        self, variant: Variant, rows: Rows, *, known: Rows = NO_ROWS, names: Sequence[str] | None = None
    ) -> Said:
        """Return what freshly read rows say, together with `known` ones: all their points, or `names`."""
        fed = self.fed_by(rows) if names is None else names
        others = {code: known[code] for name in fed for code in self._codes_of[name] if code in known}
        decoded = decode.decode_points(self._profile, variant, {**others, **rows}, names=fed)
        points = {name: _reading(decoded[name]) for name in fed if name in decoded}
        return said(rows, points, tuple(name for name in fed if name not in decoded))


def _reading(new: decode.Decoded) -> Reading:
    """Return a reading; a value that cannot be known is bad."""
    return Reading(new.value, new.unit, Quality.BAD if new.value is None else Quality.GOOD, new.label)


@once_per_profile
def sources_of(profile: Profile) -> PointSources:
    """Return the sources of a family's points, the same ones for all its starters."""
    return PointSources(profile)


class _Reply(NamedTuple):
    """The latest reply to one poll."""

    block: reading.Block
    variant: Variant
    words: Sequence[Any]
    said: Said
    is_enough: bool  # its points depend on no other rows


class ReplyReader:
    """Reads the replies of one starter to its polls: most say the same as the one before, or nearly so.

    `known` returns the rows that were current at a time, of which points with several rows may need some.
    """

    def __init__(self, profile: Profile, known: Callable[[float], Rows]) -> None:
        self._profile = profile
        self._known = known
        self._sources = sources_of(profile)
        self._latest: dict[str, _Reply] = {}  # by the poll's key

    def read(
        self, key: str, block: reading.Block, variant: Variant, words: Sequence[Any], *, at_s: float
    ) -> Said:
        """Return what a reply says; only what hangs on rows that have changed is decoded."""
        before = self._latest.get(key)
        if before is not None and not (before.block is block and before.variant is variant):
            before = None
        if before is not None and before.words == words and before.is_enough:
            return before.said
        rows, sources = block.rows_in(self._profile, words), self._sources
        is_enough = sources.are_enough(rows) if before is None else before.is_enough
        if before is not None and is_enough:
            changed = [code for code, row in rows.items() if row != before.said.rows[code]]
            new = sources.decode(variant, rows, names=sources.fed_by(changed))
            now = said(rows, {**before.said.points, **new.points})
        else:
            now = sources.decode(variant, rows, known={} if is_enough else self._known(at_s))
        self._latest[key] = _Reply(block, variant, words, now, is_enough)
        return now


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
