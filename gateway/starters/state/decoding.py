"""From rows to points: which rows a point is decoded from, of which kind it is, what replies say."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

from gateway.contract import Quality
from gateway.families import TYPE_LIMITS, Profile, Type, Variant, decode, once_per_profile, reading
from gateway.starters.state.readings import Points, Reading

ON, OFF = Reading(True, "", Quality.GOOD), Reading(False, "", Quality.GOOD)  # noqa: FBT003 - values

_MOST_CACHED = 256

Rows = Mapping[str, tuple[int, ...]]  # raw words by code
Decoders = Mapping[str, tuple[str, decode.Decoder]]  # by point, with the code of its row
NO_ROWS: Rows = {}


class Said(NamedTuple):
    """What a reply says."""

    rows: Rows
    points: Points
    missing: tuple[str, ...] = ()  # points for which a row is missing


class ReplyPlan(NamedTuple):
    """How the replies to one poll are read."""

    rows: tuple[tuple[int, int, str], ...]  # begin and end of their words, and the code; of aliases, too
    fed: tuple[str, ...]  # the points that depend on these rows
    is_complete: bool  # none of these needs another row


class PointSources:
    """Which rows each point of a family is decoded from."""

    def __init__(self, profile: Profile) -> None:
        self._profile = profile
        self._codes_of = {
            name: frozenset(reading.rows_of_points(profile, (name,))) for name in profile.points
        }
        self._fed_by = lru_cache(_MOST_CACHED)(self._find_fed)  # the same few blocks come again
        self.plan = lru_cache(_MOST_CACHED)(self._make_plan)  # the same one for all starters,
        self._decoders = lru_cache(_MOST_CACHED)(self._make_decoders)  # and the same ones for starters alike

    def fed_by(self, codes: Iterable[str]) -> tuple[str, ...]:
        """Return the points that depend on one of these rows."""
        return self._fed_by(frozenset(codes))

    def decode(
        self, variant: Variant, rows: Rows, *, known: Rows = NO_ROWS, fed: Iterable[str] | None = None
    ) -> Said:
        """Return what freshly read rows say together with `known` ones; `fed`: their points, where known."""
        decoders = self._decoders(variant)
        fed = self.fed_by(rows) if fed is None else fed
        points, several = {}, list[str]()  # of one row each, and of several
        missing: tuple[str, ...] = ()
        for name in fed:
            if name in decoders:
                code, decoded = decoders[name]
                points[name] = _reading(decoded(rows[code]))
            else:
                several.append(name)
        if several:
            found = decode.decode_points(self._profile, variant, {**known, **rows}, names=several)
            points |= {name: _reading(new) for name, new in found.items() if name in fed}
            missing = tuple(name for name in several if name not in points)
        return Said(rows, points, missing)

    def _find_fed(self, codes: frozenset[str]) -> tuple[str, ...]:
        return tuple(name for name, sources in self._codes_of.items() if not codes.isdisjoint(sources))

    def _make_plan(self, block: reading.Block) -> ReplyPlan:
        rows = tuple(
            (row.address - block.address, row.address - block.address + row.words, same.code)
            for row in block.rows
            for same in self._profile.rows_at[row.table, row.address]
        )
        codes = frozenset(code for _, _, code in rows)
        fed = self.fed_by(codes)
        return ReplyPlan(rows, fed, all(self._codes_of[name] <= codes for name in fed))

    def _make_decoders(self, variant: Variant) -> Decoders:
        """Return the row and the decoder of each point that is decoded from one row."""
        points = self._profile.points
        return {
            name: (code, decode.point_decoder(self._profile, variant, points[name]))
            for name, (code, *more) in self._codes_of.items()
            if not more
        }


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
    said: Said = Said({}, {})  # but its rows, which the snapshot has


class ReplyReader:
    """Reads the replies of one starter to its polls: most say the same as the one before.

    `known` returns the rows that were current at a time, of which points with several rows may need some.
    """

    def __init__(self, profile: Profile, known: Callable[[float], Rows]) -> None:
        self._sources = sources_of(profile)
        self._known = known
        self._replies: dict[str, _Replies] = {}  # by the poll's key

    def read(
        self, key: str, block: reading.Block, variant: Variant, words: Sequence[Any], *, at_s: float
    ) -> Said:
        """Return what a reply says."""
        replies, sources = self._replies.get(key), self._sources
        if replies is None or replies.block is not block or replies.variant is not variant:
            replies = _Replies(block, variant, sources.plan(block))
        rows = {code: tuple(map(int, words[begin:end])) for begin, end, code in replies.plan.rows}
        if words == replies.words and replies.plan.is_complete:
            return replies.said._replace(rows=rows)
        known = NO_ROWS if replies.plan.is_complete else self._known(at_s)
        said = sources.decode(variant, rows, fed=replies.plan.fed, known=known)
        self._replies[key] = replies._replace(words=words, said=said._replace(rows=NO_ROWS))
        return said


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
    if row.type in (Type.ENUM, Type.LOW_ENUM):
        return "enum"
    if row.type not in TYPE_LIMITS:
        return "string"
    return "float" if row.decimals or row.unit else "integer"
