"""From rows to points: which rows a point is decoded from, of which kind it is, what replies say."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

from gateway.contract import Quality
from gateway.families import TYPE_LIMITS, Profile, Type, Variant, decode, once_per_profile, reading
from gateway.starters.state.readings import NO_POINTS, Points, Reading

ON, OFF = Reading(True, "", Quality.GOOD), Reading(False, "", Quality.GOOD)  # noqa: FBT003 - values
NOT_KNOWN = Reading(None, "", Quality.BAD)

_MOST_CACHED = 256

Rows = Mapping[str, tuple[int, ...]]  # raw words by code
Decoders = Mapping[str, tuple[str, decode.Decoder]]  # by point, with the code of its row
NO_ROWS: Rows = {}


class Said(NamedTuple):
    """What a reply says."""

    rows: Rows
    points: Points


class ReplyPlan(NamedTuple):
    """How the replies to one poll are read."""

    rows: tuple[tuple[int, int, str], ...]  # begin and end of their words, and the code; of aliases, too
    fed: tuple[str, ...]  # the points that depend on these rows
    is_complete: bool  # none of these is made of a point from another row


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
        self, variant: Variant, rows: Rows, *, known: Points = NO_POINTS, fed: Iterable[str] | None = None
    ) -> Said:
        """Return what freshly read rows say; `known` points are parts of others, `fed` theirs where known."""
        decoders, points, made = self._decoders(variant), dict[str, Reading](), list[str]()
        for name in self.fed_by(rows) if fed is None else fed:
            if name in decoders:
                code, decoded = decoders[name]
                points[name] = _reading(decoded(rows[code]))
            else:
                made.append(name)  # of other points, which may come after it
        for name in made:
            parts = self._profile.points[name].none_of
            points[name] = _none_of([points.get(part) or known.get(part, NOT_KNOWN) for part in parts])
        return Said(rows, points)

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
        """Return the row and the decoder of each point that is not made of others."""
        return {
            name: (point.code, decode.point_decoder(self._profile, variant, point))
            for name, point in self._profile.points.items()
            if not point.none_of
        }


def _reading(new: decode.Decoded) -> Reading:
    """Return a reading; a value that cannot be known is bad. Booleans are the same objects for all."""
    if isinstance(new.value, bool):
        return ON if new.value else OFF
    return Reading(new.value, new.unit, Quality.BAD if new.value is None else Quality.GOOD, new.label)


def _none_of(parts: Sequence[Reading]) -> Reading:
    """Return the reading of a point that is true while none of its parts is; one that is decides alone."""
    values = [part.value for part in parts if part.quality is Quality.GOOD]
    if any(values):
        return OFF
    return ON if len(values) == len(parts) else NOT_KNOWN


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

    `known` returns the points as they are known, of which others may be made.
    """

    def __init__(self, profile: Profile, known: Callable[[], Points]) -> None:
        self._sources = sources_of(profile)
        self._known = known
        self._replies: dict[str, _Replies] = {}  # by the poll's key

    def read(self, key: str, block: reading.Block, variant: Variant, words: Sequence[Any]) -> Said:
        """Return what a reply says."""
        replies, sources = self._replies.get(key), self._sources
        if replies is None or replies.block is not block or replies.variant is not variant:
            replies = _Replies(block, variant, sources.plan(block))
        rows = {code: tuple(map(int, words[begin:end])) for begin, end, code in replies.plan.rows}
        if words == replies.words and replies.plan.is_complete:
            return replies.said._replace(rows=rows)
        known = NO_POINTS if replies.plan.is_complete else self._known()
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
