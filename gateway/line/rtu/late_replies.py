"""Which replies may still come on a line, and how none of them passes for the answer to a later request.

An RTU reply carries no number. What it shows is its unit, its function and its length (a write's reply:
what was written); function and length are its *shape* here. So the same registers are asked for in another
*form* while a unit may still send a reply of their own shape: a register or more besides, or coils for a
word (`families/alternates.py`). A late, doubled or swapped reply then shows by its shape or its unit.

Invariants
 1. What a unit did not answer in time it *owes*: until it comes late, or `LATE_S` have passed.
 2. For `COPY_S` after a reply its copy may begin: nothing is asked in that shape meanwhile, and nothing of
    its function after a refusal. Only on a calm line the same read may follow at once: a copy says what was
    so a moment before. The answer that it was taken for may come itself: for `LATE_S` no other frame of that
    shape ends what is owed.
 3. A line is *disturbed* for `DISTURBED_S` after anything late, doubled or foreign. Two readings in a row
    that decide something have different shapes meanwhile, where another is free: so the rule that a change
    is an event after two equal readings (`telemetry/transitions.py`) nearly always means two of different
    shapes. Where only one is free no reply that is owed has its shape; a series shows by itself what is so.
 4. Whether replies are late or lost is a property of the way, and shows: a *lost* one has not come after
    `LOST_AFTER_S` though its unit has answered since. After `LOST_ENOUGH` of them in a row a line is
    *orderly*: there an answer ends what its unit owed before. One reply that comes out of order makes the
    line strict again, for `STRICT_S`.
 5. A write is never held back. Where an equal reply is owed its acknowledgement is not believed: the read-
    back decides. What is known is since when such a write was acknowledged, enough for one that is repeated:
    it counts for the oldest that is owed, so that the next is of a later write.
    A refusal shows its function only: it is not believed while the unit owes a reply to that function, and
    what it refused is asked again after that.
 6. Identification replies (FC43) name what they answer: they are always believed.
 7. What is owed outlives the port: a serial server may deliver it to the next connection.

Precedence of the forms of a read
 1. The request itself, when nothing is owed, near or disturbed.
 2. The first form whose shape is not owed, on a disturbed line of another shape than the reading before. On
    a strict line, what decides nothing takes its own shape last, which others need.
 3. On an orderly line, of the forms whose replies were lost, the one that was asked for the longest ago.
 4. A read that decides something: the form owed least often, n times, until n + 1 answers in a row are
    equal. n of them may be late ones, one is fresh. Before the next such *series* its poll rests for
    `REST_S` x (n^2 - 1), so that more is not owed for asking more often.
 5. Anything else waits.
"""

from __future__ import annotations

import enum
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from typing import Any, NamedTuple

from gateway.modbus.codes import EXCEPTION_BIT, Function
from gateway.modbus.pdu import Request

LATE_S = 30.0  # a reply that was not in time may come for so long
COPY_S = 0.025  # from the end of a reply to the beginning of its copy, at most
LONGEST_REPLY_S = 0.3  # on the wire at 9600 bit/s
DISTURBED_S = 60.0
LOST_ENOUGH = 30  # replies in a row; where one in five of those missed is late, 0.1 % of such rows have none
STRICT_S = 600.0
LOST_AFTER_S = 10.0  # a reply counts as lost; on an orderly line its shape is free again
LIKELY = 3.0  # times as late as it was waited for: before that it is not asked again in the same shape
LOOK_AGAIN_S = 0.1  # what waits for a late reply is looked at so often
REST_S = 0.15
SERIES_WITHIN_S = 1.0  # between two answers of a series

_NAMED = frozenset({Function.WRITE_COIL, Function.WRITE_REGISTER, Function.MASK_WRITE_REGISTER})
_ADDRESSED = frozenset({Function.WRITE_COILS, Function.WRITE_REGISTERS})
_ADDRESSED_SIZE = 3  # function and address
_COUNTED_SIZE = 2  # function and byte count

Shape = bytes
_NO_SHAPES: set[Shape] = set()


def shape_of(pdu: bytes) -> Shape:
    """Return what of a reply distinguishes it from others of its unit."""
    function = pdu[0]
    if function in _NAMED:
        return pdu
    if function in _ADDRESSED:
        return pdu[:_ADDRESSED_SIZE]
    if function == Function.ENCAPSULATED or function & EXCEPTION_BIT:
        return pdu[:1]
    return pdu[:_COUNTED_SIZE]


def expected_shape(request: Request) -> Shape:
    """Return the shape of a request's normal reply."""
    function = request.function
    if function in _NAMED or function in _ADDRESSED or function == Function.ENCAPSULATED:
        return shape_of(request.encode())  # such a reply begins as its request
    return bytes((function, (request.reply_size() or _COUNTED_SIZE) - _COUNTED_SIZE))


class Agreed(enum.Enum):
    """What one more answer makes of a series."""

    YES = enum.auto()
    NOT_YET = enum.auto()
    NO = enum.auto()  # it said something else than the one before


class Choice(NamedTuple):
    """A form that may be sent now, and how many equal answers count as one."""

    at: int
    times: int = 1


@dataclass(slots=True)
class _Debt:
    shape: Shape
    asked_s: float
    likely_until_s: float
    asked: Request | None = None
    is_passed: bool = False  # its unit has answered a later request
    is_lost: bool = False  # so far


class _Copy(NamedTuple):
    """A second sending of a reply, which may begin until then."""

    until_s: float
    pdu: bytes
    shape: Shape
    request: Request | None  # that it answers; None: not known


@dataclass(slots=True)
class _Series:
    shape: Shape
    needed: int
    value: Any
    at_s: float
    answers: int = 1


class LateReplies:
    """What the units of one line may still send; times in seconds on the line's clock."""

    def __init__(self) -> None:
        self.came_late: Counter[int] = Counter()  # replies by unit, since the start
        self.just_came: list[
            int
        ] = []  # units that owed something, of whom a frame came; the reader clears it
        self._debts: dict[int, list[_Debt]] = {}  # by unit, the oldest first
        self._copied_s: dict[tuple[int, Shape], float] = {}  # when the latest answer came that may be a copy
        self._copies: dict[int, list[_Copy]] = {}  # by unit: of its latest replies
        self._refused: set[tuple[int, Request]] = set()  # as it seemed
        self._latest: dict[tuple[int, Request], Shape] = {}  # of the answers on a disturbed line
        self._series: dict[tuple[int, Request], _Series] = {}
        self._rests: dict[tuple[int, Request], float] = {}  # until when there is no other series
        self._disturbed_until_s = self._strict_until_s = -inf
        self._lost = 0  # replies in a row that never came

    def is_disturbed(self, now_s: float) -> bool:
        """Return whether anything was late, doubled or foreign in the last minute."""
        return now_s < self._disturbed_until_s

    def is_orderly(self, now_s: float) -> bool:
        """Return whether replies are lost here, but never late."""
        return self._lost >= LOST_ENOUGH and now_s >= self._strict_until_s

    def is_calm(self, unit: int, now_s: float) -> bool:
        """Return whether any request of this unit may be sent as it is."""
        copies = self._copies.get(unit)
        is_near = copies is not None and copies[-1].until_s > now_s
        return not (is_near or unit in self._debts or now_s < self._disturbed_until_s)

    def owes(self, unit: int) -> bool:
        """Return whether a reply of this unit may still come."""
        return unit in self._debts

    def is_anyone_late(self, now_s: float) -> bool:
        """Return whether anyone owes anything."""
        return any(self._owed(unit, now_s) for unit in list(self._debts))

    def acknowledges_since_s(self, unit: int, request: Request, shape: Shape, now_s: float) -> float:
        """Return how long ago the write may have been sent that the next acknowledgement of one is for.

        That of the oldest whose own is owed; `now_s` where it can only be the one sent now.
        """
        if shape in self._near(unit, request, now_s)[1]:
            return -inf
        owed_s = [debt.asked_s for debt in self._believed(unit, now_s) if debt.shape == shape]
        return min(owed_s, default=now_s)

    def is_refusal_sure(
        self, unit: int, function: int, now_s: float, *, literal: Request | None = None
    ) -> bool:
        """Return whether a refusal can only be the answer to what was asked last, or to `literal` before."""
        return all(
            debt.shape[0] != function or (literal is not None and debt.asked == literal)
            for debt in self._believed(unit, now_s)
        )

    def choose(
        self,
        unit: int,
        asked: Request,
        shapes: Sequence[Shape],
        now_s: float,
        *,
        is_decisive: bool = True,
        is_patient: bool = False,
        is_literal: bool = False,
    ) -> Choice | None:
        """Return which form of a read may be sent; None while there is none. The first is the request itself.

        What `is_patient` rests after a series, as polls do and commands do not. What `is_literal` is asked
        again at once after a refusal in doubt: who asks it knows what several of them say.
        """
        owed = self._owed(unit, now_s)
        if asked.function == Function.ENCAPSULATED:
            return Choice(0)
        is_varied = is_decisive and len(shapes) > 1 and self.is_disturbed(now_s)
        near, near_asked = self._near(unit, asked, now_s)
        is_refused = not is_literal and self._is_refused(unit, asked, now_s)
        if is_refused or _refusal(asked) in near:
            return None
        latest = self._latest.get((unit, asked)) if is_varied else None
        is_last = not is_decisive and owed and not self.is_orderly(now_s)  # others need its own shape
        order = (*range(1, len(shapes)), 0) if is_last else range(len(shapes))
        calm = [at for at in order if shapes[at] not in (near if at else near_asked)]
        since_s = now_s - LOST_AFTER_S if self.is_orderly(now_s) else -inf
        newest_s = {debt.shape: debt.asked_s for debt in owed if debt.asked_s > since_s or not debt.is_passed}
        free = [at for at in order if shapes[at] not in newest_s]
        if free:
            others = [at for at in free if shapes[at] != latest] or free
            return next((Choice(at) for at in others if at in calm), None)
        counts = dict.fromkeys(newest_s, 0)
        likely = set()
        for debt in self._believed(unit, now_s):
            counts[debt.shape] += 1
            if debt.likely_until_s > now_s:
                likely.add(debt.shape)
        places = {at: counts[shapes[at]] for at in calm if shapes[at] not in likely}
        lost = [at for at, count in places.items() if count == 0]
        if lost:
            return Choice(min(lost, key=lambda at: (shapes[at] == latest, newest_s[shapes[at]])))
        if not is_decisive or (is_patient and now_s < self._rests.get((unit, asked), -inf)):
            return None
        return self._in_series(unit, asked, places, shapes, now_s)

    def free_from_s(self, unit: int, asked: Request, now_s: float) -> float:
        """Return from when on it is worth looking again whether a read may be sent."""
        copied_s = max((copy.until_s for copy in self._copies.get(unit, ())), default=-inf)
        likely_s = max((debt.likely_until_s for debt in self._debts.get(unit, ())), default=-inf)
        times_s = (copied_s, likely_s, self._rests.get((unit, asked), -inf), now_s + LOOK_AGAIN_S)
        return min(at_s for at_s in times_s if at_s > now_s)

    def note_sent(self, unit: int, asked: Request, shape: Shape) -> None:
        """Record a request: of the answers to a series in its shape, one may now be its own."""
        if self._series:
            self._end_series(unit, shape, but=asked)

    def note_answer(
        self,
        unit: int,
        request: Request,
        asked: Request,
        pdu: bytes,
        at_s: float,
        *,
        began_s: float = inf,
        is_sure: bool = True,
    ) -> None:
        """Record the reply to the latest request, a form of `asked`; an answer in a series is not sure."""
        if self._add_copy(unit, pdu, at_s, began_s=began_s, request=request):
            self._copied_s[unit, shape_of(pdu)] = at_s
        if is_sure:
            for debt in self._debts.get(unit, ()):
                debt.is_passed = True
            self._note_latest(unit, asked, shape_of(pdu), at_s)

    def note_unanswered(
        self, unit: int, shape: Shape, asked_s: float, now_s: float, asked: Request | None = None
    ) -> None:
        """Record that the reply to a request was not in time."""
        debt = _Debt(shape, asked_s, asked_s + LIKELY * (now_s - asked_s), asked)
        self._debts.setdefault(unit, []).append(debt)
        self._end_series(unit, shape)

    def note_refusal_doubted(self, unit: int, asked: Request) -> None:
        """Record that an exception came which may answer an earlier request."""
        self._refused.add((unit, asked))

    def retry_refused(self, unit: int) -> None:
        """Ask again at once what a unit seemed to refuse: another device answers there now."""
        self._refused = {each for each in self._refused if each[0] != unit}

    def note_stray(
        self, unit: int, pdu: bytes, *, began_s: float, at_s: float, awaited: Shape | None = None
    ) -> None:
        """Record a whole frame that is no answer; `awaited` is what its unit is asked for.

        It began at `began_s` or later. A refusal or an acknowledgement may be the answer after all: it says
        nothing about the line.
        """
        shape = shape_of(pdu)
        if unit in self._debts:
            self.just_came.append(unit)
        is_acknowledgement = shape == awaited and pdu[0] in _NAMED | _ADDRESSED
        may_be_copy = self._add_copy(unit, pdu, at_s, began_s=began_s)
        if is_acknowledgement and not may_be_copy:
            self._count_for_oldest(unit, shape)
        if is_acknowledgement or (awaited is not None and pdu[0] == awaited[0] | EXCEPTION_BIT):
            return
        self._disturbed_until_s = at_s + DISTURBED_S
        if may_be_copy:
            return
        debts = self._debts.get(unit, [])
        if at_s < self._copied_s.get((unit, shape), -inf) + LATE_S:
            came = None  # or what that copy was taken for
        elif pdu[0] & EXCEPTION_BIT:
            possible = [debt for debt in debts if debt.shape[0] == pdu[0] & ~EXCEPTION_BIT]
            came = possible[0] if len(possible) == 1 else None
        else:
            came = next((debt for debt in debts if debt.shape == shape != awaited), None)
        if came is not None:
            self.came_late[unit] += 1
            debts.remove(came)
            if not debts:
                del self._debts[unit]
        if came is None or came.is_passed:
            self._lost, self._strict_until_s = 0, at_s + STRICT_S

    def agree(self, unit: int, asked: Request, shape: Shape, value: Any, now_s: float, times: int) -> Agreed:
        """Record one answer of a series, of which `times` are needed."""
        key = (unit, asked)
        series = self._series.get(key)
        if series is None or series.shape != shape or now_s - series.at_s > SERIES_WITHIN_S:
            self._series[key] = _Series(shape, times, value, now_s)
            return Agreed.NOT_YET
        is_equal = series.value == value
        series.answers, series.at_s = series.answers + 1, now_s
        if is_equal and series.answers < series.needed:
            return Agreed.NOT_YET
        del self._series[key]
        self._rests[key] = now_s + REST_S * ((series.needed - 1) ** 2 - 1)
        if not is_equal:
            return Agreed.NO
        self._note_latest(unit, asked, shape, now_s)
        return Agreed.YES

    def forget(self, unit: int) -> None:
        """Drop what was noted of a unit's requests: it is another one now. What it owes may still come."""
        self.retry_refused(unit)
        self._latest = {key: shape for key, shape in self._latest.items() if key[0] != unit}
        self._series = {key: series for key, series in self._series.items() if key[0] != unit}
        self._rests = {key: until_s for key, until_s in self._rests.items() if key[0] != unit}

    def _count_for_oldest(self, unit: int, shape: Shape) -> None:
        """Count an acknowledgement that may be of any of several writes for the oldest: it owes no other."""
        debts = self._debts.get(unit, [])
        oldest = next((debt for debt in debts if debt.shape == shape), None)
        if oldest is not None:
            debts.remove(oldest)
            if not debts:
                del self._debts[unit]

    def _note_latest(self, unit: int, asked: Request, shape: Shape, at_s: float) -> None:
        """Record the shape of a reading that counts: a series under way keeps its own."""
        if at_s < self._disturbed_until_s:
            self._latest[unit, asked] = shape
        elif self._latest:
            self._latest.clear()

    def _end_series(self, unit: int, shape: Shape, *, but: Request | None = None) -> None:
        for key, series in list(self._series.items()):
            if key[0] == unit and key[1] != but and series.shape == shape:
                del self._series[key]

    def _in_series(
        self, unit: int, asked: Request, counts: dict[int, int], shapes: Sequence[Shape], now_s: float
    ) -> Choice | None:
        """Return the form of the series under way, or the one that is owed least often."""
        series = self._series.get((unit, asked))
        if series is not None and now_s - series.at_s <= SERIES_WITHIN_S:
            at = next((at for at in counts if shapes[at] == series.shape), None)
            return None if at is None else Choice(at, series.needed)
        least = min(counts, key=lambda at: counts[at], default=None)
        return None if least is None else Choice(least, counts[least] + 1)

    def _owed(self, unit: int, now_s: float) -> list[_Debt]:
        """Return all that a unit may still send, and count what seems to be lost."""
        debts = self._debts.get(unit)
        if debts is None:
            return []
        for debt in debts:
            if debt.asked_s > now_s - LOST_AFTER_S:
                break
            if debt.is_passed and not debt.is_lost:
                debt.is_lost = True
                self._lost += 1
        while debts and debts[0].asked_s <= now_s - LATE_S:
            del debts[0]
        if not debts:
            del self._debts[unit]
        return debts

    def _believed(self, unit: int, now_s: float) -> list[_Debt]:
        """Return what a unit may still send as far as the line is known."""
        owed = self._owed(unit, now_s)
        return [debt for debt in owed if not debt.is_passed] if self.is_orderly(now_s) else owed

    def _near(self, unit: int, asked: Request, now_s: float) -> tuple[set[Shape], set[Shape]]:
        """Return the shapes of copies that may still begin: of any, and of those that harm `asked` itself."""
        copies = [each for each in self._copies.get(unit, ()) if each.until_s > now_s]
        if not copies:
            return _NO_SHAPES, _NO_SHAPES
        near = {each.shape for each in copies}
        if self.is_disturbed(now_s):
            return near, near
        return near, {each.shape for each in copies if each.request != asked}

    def _is_refused(self, unit: int, asked: Request, now_s: float) -> bool:
        if (unit, asked) not in self._refused:
            return False
        if not self.is_refusal_sure(unit, asked.function, now_s):
            return True
        self._refused.discard((unit, asked))
        return False

    def _add_copy(
        self, unit: int, pdu: bytes, at_s: float, *, began_s: float, request: Request | None = None
    ) -> bool:
        """Record a reply whose copy may come; return whether it may itself be one."""
        copies = self._copies.setdefault(unit, [])
        may_be_copy = False
        if copies and copies[-1].until_s >= began_s:
            may_be_copy = any(each.until_s >= began_s and each.pdu == pdu for each in copies)
        copy = _Copy(at_s + COPY_S, pdu, shape_of(pdu), request)
        while copies and copies[0].until_s + LONGEST_REPLY_S < copy.until_s:
            del copies[0]
        copies.append(copy)
        return may_be_copy


def _refusal(request: Request) -> Shape:
    return bytes((request.function | EXCEPTION_BIT,))
