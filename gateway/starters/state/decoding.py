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

ON, OFF = Reading(True, "", Quality.GOOD), Reading(False, "", Quality.GOOD)  # noqa: FBT003 - values

_MOST_CACHED = 256

Rows = Mapping[str, tuple[int, ...]]  # raw words by code
NO_ROWS: Rows = {}


class Said(NamedTuple):
    """What a reply says."""

    rows: Rows
    points: Points
    missing: tuple[str, ...] = ()  # points for which a row is missing
    values: Mapping[str, Value] = {}  # the good ones of `points`


class RowPlan(NamedTuple):
    """Where a row's words are in the replies to one poll, and what is decoded from them."""

    start: int
    end: int
    codes: tuple[str, ...]  # of the row and its aliases
    points: tuple[tuple[str, decode.Decoder], ...]  # those that depend on no other row


class ReplyPlan(NamedTuple):
    """How the replies to one poll are read."""

    rows: tuple[RowPlan, ...]
    names: tuple[str, ...]  # of all points that depend on these rows
    is_joint: bool  # one of them depends on several rows: all are decoded together
    is_whole: bool  # all their rows are in these replies


class PointSources:
    """Which rows each point of a family is decoded from."""

    def __init__(self, profile: Profile) -> None:
        self._profile = profile
        self._codes_of = {
            name: frozenset(reading.rows_of_points(profile, (name,))) for name in profile.points
        }
        self._fed_by = lru_cache(_MOST_CACHED)(self._find_fed)  # the same few blocks come again
        self.plan = lru_cache(_MOST_CACHED)(self._make_plan)  # the same one for starters alike

    def fed_by(self, codes: Iterable[str]) -> tuple[str, ...]:
        """Return the points that depend on one of these rows."""
        return self._fed_by(frozenset(codes))

    def _find_fed(self, codes: frozenset[str]) -> tuple[str, ...]:
        return tuple(name for name, sources in self._codes_of.items() if not codes.isdisjoint(sources))

    def _make_plan(self, codes: tuple[str, ...], variant: Variant) -> ReplyPlan:
        """Return how the replies with these rows, by address, are read."""
        profile, rows = self._profile, list[RowPlan]()
        first = profile.parameters[codes[0]].address
        for row in (profile.parameters[code] for code in codes):
            same = tuple(each.code for each in profile.rows_at[row.table, row.address])
            points = tuple(
                (name, decode.point_decoder(profile, variant, profile.points[name]))
                for name in self.fed_by(same)
                if len(self._codes_of[name]) == 1
            )
            rows.append(RowPlan(row.address - first, row.address - first + row.words, same, points))
        found = frozenset(code for row in rows for code in row.codes)
        names = self.fed_by(found)
        sources = [self._codes_of[name] for name in names]
        is_joint = any(len(codes) > 1 for codes in sources)
        return ReplyPlan(tuple(rows), names, is_joint, all(codes <= found for codes in sources))

    def decode(self, variant: Variant, rows: Rows, *, known: Rows = NO_ROWS) -> Said:
        """Return what freshly read rows say, together with `known` ones."""
        fed = self.fed_by(rows)
        found = decode.decode_points(self._profile, variant, {**known, **rows}, names=fed)
        points = {name: _reading(found[name]) for name in fed if name in found}
        return Said(rows, points, tuple(name for name in fed if name not in found), good_values(points))


def _reading(new: decode.Decoded) -> Reading:
    """Return a reading; a value that cannot be known is bad. Booleans are the same objects for all."""
    if isinstance(new.value, bool):
        return ON if new.value else OFF
    return Reading(new.value, new.unit, Quality.BAD if new.value is None else Quality.GOOD, new.label)


@once_per_profile
def sources_of(profile: Profile) -> PointSources:
    """Return the sources of a family's points, the same ones for all its starters."""
    return PointSources(profile)


class _Replies(NamedTuple):
    """The replies to one poll: how they are read, and what the latest says."""

    block: reading.Block
    variant: Variant
    plan: ReplyPlan
    words: Sequence[Any] = ()
    said: Said = Said({}, {})


class ReplyReader:
    """Reads the replies of one starter to its polls: most say the same as the one before, or nearly so.

    `known` returns the rows that were current at a time, of which points with several rows may need some.
    """

    def __init__(self, profile: Profile, known: Callable[[float], Rows]) -> None:
        self._profile = profile
        self._known = known
        self._replies: dict[str, _Replies] = {}  # by the poll's key

    def read(
        self, key: str, block: reading.Block, variant: Variant, words: Sequence[Any], *, at_s: float
    ) -> Said:
        """Return what a reply says; only what hangs on words that have changed is decoded."""
        replies = self._replies.get(key)
        if replies is None or replies.block is not block or replies.variant is not variant:
            replies = _Replies(block, variant, sources_of(self._profile).plan(block.codes, variant))
        elif words == replies.words and replies.plan.is_whole:
            return replies.said
        plan, before, old = replies.plan, replies.said, replies.words
        rows, points = dict(before.rows), dict(before.points)
        for start, end, codes, decoders in plan.rows:
            if words[start:end] != old[start:end]:
                row = tuple(map(int, words[start:end]))
                rows.update(dict.fromkeys(codes, row))
                for name, decoded in decoders:
                    points[name] = _reading(decoded(row))
        if plan.is_joint:
            known = NO_ROWS if plan.is_whole else self._known(at_s)
            now = sources_of(self._profile).decode(variant, rows, known=known)
        else:
            points = points if old else {name: points[name] for name in plan.names}
            now = Said(rows, points, values=good_values(points))
        self._replies[key] = replies._replace(words=words, said=now)
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
def unread_points(profile: Profile) -> Points:
    """Return all points as they are before the first reply: bad."""
    return {name: Reading(None, unit_of(profile, name), Quality.BAD) for name in profile.points}


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
