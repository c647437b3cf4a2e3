"""From rows to points: which points a row feeds, and what freshly read rows say about them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from gateway.families.decode import Decoded, decode_points
from gateway.families.gather import rows_of_points
from gateway.families.numbers import TYPE_LIMITS
from gateway.families.schema import Profile, Type, Variant

TEXT_TYPES = tuple(kind for kind in Type if kind not in TYPE_LIMITS)
ENUM_TYPES = (Type.ENUM, Type.LOW_ENUM)

_MOST_KEPT = 64


class Sources:
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
