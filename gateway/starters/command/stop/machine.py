"""Stops one starter: frames before everything else, again and again, until read back or the time is up.

1. Each stop message is an order with a frame of its own (`frames`), and joins the stop under way.
2. A message is confirmed by two readings in a row that were asked for after the frame which counts for it:
   its own, or the first after that which the starter acknowledged. Without an acknowledgement, frames follow
   until the time is up; then the latest two readings since the first frame decide.
3. A reading that was lost says nothing, for `SEEN_WITHIN_S`; one that shows otherwise ends the row.
4. A start or a jog that did not act is taken back by the same machine, with an order of the gateway's own
   (`released`): it also asks for run and jog to read 0 in remote mode. A newer command ends it, its outcome
   is an event and an entry of the audit.

Of a group each member is stopped so on its own: `group`.
"""

from __future__ import annotations

import asyncio
from collections.abc import Collection
from dataclasses import dataclass, field
from math import inf
from typing import Any

from gateway.contract import EventCode, Note, Phase, Reason, ResultCode
from gateway.families import Expect
from gateway.line import Priority
from gateway.starters.command.addressee import StopAddressee
from gateway.starters.command.report import MAY_BE_TURNING, CommandReport, Final
from gateway.starters.command.stop.frames import Frames
from gateway.starters.command.wire import (
    EQUAL_READINGS,
    READ_BACK_PAUSE_S,
    Wire,
    points_of,
)
from gateway.starters.starter import StarterTelemetry

DEADLINE_S = 10.0  # of each message
UNREAD_PAUSE_S = 0.5  # between two readings of a starter that did not answer the latest two
LAST_READING_S = 5.0  # after that a reading which waits for a full line is waited for no longer
SEEN_WITHIN_S = 2.0  # before its end, so that a stop counts as seen


@dataclass(slots=True, eq=False)
class StopOrder:
    """One stop message, or the gateway's own order to take a start back."""

    frame: int  # the number of its own frame
    until_s: float  # when its time is up
    is_shared: bool  # that frame is other messages' as well
    report: CommandReport | None = None  # None: it gets no answer of its own
    released: Expect | None = None  # of a start that is taken back: what must be read besides
    over: asyncio.Event = field(default_factory=asyncio.Event)
    counts_from: float = inf  # the first reading that counts; inf: its frame has not left yet
    is_taken: bool = False  # the starter acknowledged its frame, or a later one
    good: list[tuple[int, float]] = field(default_factory=list)  # the latest two that show it, and when

    @property
    def is_written(self) -> bool:
        """Return whether its frame may have reached the starter."""
        return self.counts_from < inf

    @property
    def is_own(self) -> bool:
        """Return whether the gateway gave it, not a client."""
        return self.released is not None

    def note_written(self, *, is_acknowledged: bool, next_reading: int) -> None:
        """Record a frame that left; until one is acknowledged an earlier start may yet act."""
        if self.is_taken:
            return
        if self.report is not None and not self.is_written:
            self.report.write()
        self.is_taken = is_acknowledged
        if self.is_taken or not self.is_written:
            self.counts_from = next_reading

    def note_reading(self, number: int, expect: Expect, values: dict[str, Any], now_s: float) -> bool:
        """Record a reading; return whether it shows what this order is for."""
        is_shown = expect.is_met(values) and (self.released is None or self.released.is_met(values))
        self.good = [*self.good, (number, now_s)][-EQUAL_READINGS:] if is_shown else []
        return is_shown

    def is_seen(self, now_s: float) -> bool:
        """Return whether two readings in a row show it, and count for it."""
        counting = [at_s for number, at_s in self.good if number >= self.counts_from]
        return len(counting) == EQUAL_READINGS and now_s - counting[-1] <= SEEN_WITHIN_S


class Stopping:
    """One starter's stop under way; every stop message that comes meanwhile joins it."""

    def __init__(self, starter: StarterTelemetry) -> None:
        self._event, self._starter = starter.event, StopAddressee(starter)
        self.wire = Wire(self._starter, read_back_lane=Priority.FOLLOW_UP)
        self.frames = Frames(self._starter, self.wire, self._next_lane, self._note_written)
        self._orders: list[StopOrder] = []  # at most one message without an answer, which stands for all such
        self._readings = 0  # begun
        self._unread = 0  # the latest of them in a row that were not answered
        self._shown: dict[str, Any] = {}  # by the latest of them

    def ask(self, released: Expect | None = None, *, with_jog: bool = False) -> StopOrder:
        """Have a frame sent for one more message, and see it through; a report gives it an answer.

        `released`: to take back what a command may have left in the starter, until that is read as well.
        `with_jog`: a jog may have been written that no reading has shown.
        """
        self.frames.with_jog |= with_jog or released is not None
        self._orders = [order for order in self._orders if order.report]
        frame, until_s = self.frames.ask(), self.wire.now_s() + DEADLINE_S
        self._orders.append(StopOrder(frame, until_s, frame > self.frames.handed, released=released))
        return self._orders[-1]

    def join(self, report: CommandReport) -> None:
        """Report the end of the stop command, already accepted, for which `ask` was just called."""
        self._orders[-1].report = report
        report.before = self._starter.snapshot.good_values()

    @property
    def is_own(self) -> bool:
        """Return whether it only takes a start back: a newer command may end it."""
        return all(order.is_own for order in self._orders)

    def give_way(self) -> None:
        """End, for the audit alone, and let nothing more go out: a newer command has been accepted."""
        for order in tuple(self._orders):
            self._finish(order, self._cut(order, Reason(ResultCode.BUSY, "command")))
        self.wire.halt(Reason(ResultCode.OK, "accepted"))

    def cut(self, reason: Reason) -> None:
        """End every stop command that has joined."""
        self.frames.close()
        self._end([(order, self._cut(order, reason)) for order in self._orders])

    def _next_lane(self) -> Priority | None:
        """Return how soon the next frame is to be sent; None: none is needed."""
        if all(order.good and order.is_taken for order in self._orders):
            return None
        return Priority.FOLLOW_UP if all(order.is_written for order in self._orders) else Priority.STOP

    def _note_written(self, number: int, *, is_acknowledged: bool) -> None:
        for order in self._orders:
            if order.frame <= number:
                order.note_written(is_acknowledged=is_acknowledged, next_reading=self._readings + 1)

    # The readings

    async def run(self) -> None:
        """Read the starter back until every stop command that has joined has its end; HaltedError."""
        while self._orders:
            shown: Collection[StopOrder] = ()
            if any(order.is_written for order in self._orders):
                self._readings += 1
                shown = await self._read_back()
                self.wire.until_s = inf
                await asyncio.sleep(0)  # the readings are published before the results that rest on them
            else:
                self.frames.procedure()  # what cannot be built cannot be sent
            self._end_what_is_over(shown)
            self.frames.send_if_due()
            if self._orders:  # a silent starter costs its line a time-out each time
                pause_s = READ_BACK_PAUSE_S if self._unread < EQUAL_READINGS else UNREAD_PAUSE_S
                await self.wire.wait_for(asyncio.sleep(pause_s))
        self.frames.close()

    async def _read_back(self) -> Collection[StopOrder]:
        """Read once; return the orders for which that shows what they are for."""
        expect, number = self.frames.procedure().verify, self._readings
        self.wire.until_s = min(order.until_s for order in self._orders) + LAST_READING_S
        rows = None if expect is None else await self.wire.read_back(expect.reads)
        self._unread = self._unread + 1 if rows is None else 0
        if expect is None or rows is None:
            return ()
        # What a start that is taken back needs besides: a starter may refuse it, and is stopped all the same.
        released = [order.released for order in self._orders if order.released and not self._starter.is_other]
        for each in released[:1]:
            rows |= await self.wire.read_back(each.reads) or {}
        self.frames.is_answered, now_s = True, self.wire.now_s()
        self._shown = self.wire.values(rows)
        return [order for order in self._orders if order.note_reading(number, expect, self._shown, now_s)]

    # The ends

    def _end_what_is_over(self, shown: Collection[StopOrder]) -> None:
        """End the messages that are read back, and those whose time is up unless a stop was just seen."""
        ends: list[tuple[StopOrder, Final]] = []
        now_s = self.wire.now_s()
        for order in self._orders:
            is_over = now_s >= order.until_s
            if order.is_seen(now_s) and (order.is_taken or is_over):
                reason = Reason(ResultCode.OK, "read_back").noted(self.frames.babble)
                ends.append((order, Final(Phase.CONFIRMED, reason, after=points_of(self._shown))))
            elif is_over and order not in shown:
                ends.append((order, self._unseen(order)))
        self._end(ends)

    def _end(self, ends: Collection[tuple[StopOrder, Final]]) -> None:
        """Give messages their ends; one event is published for all that are not confirmed."""
        note = self._starter.note(self.frames.families)
        ends = [(order, end.noted(note)) for order, end in ends]
        for _, end in [each for each in ends if each[1].phase is not Phase.CONFIRMED][:1]:
            self._event(
                EventCode.STOP_UNCONFIRMED, phase=end.phase, code=end.reason.code, outcome=end.reason.text
            )
        for order, end in ends:
            self._finish(order, end)

    def _finish(self, order: StopOrder, end: Final) -> None:
        order.over.set()
        self._orders.remove(order)
        if order.report is not None:
            order.report.finish(end)

    def _unseen(self, order: StopOrder) -> Final:
        """Return the end of a stop whose time is up."""
        frames = self.frames
        if order.is_written and not frames.is_answered and frames.babble is None:
            reason = Reason(ResultCode.NO_ANSWER, "stop", within_s=DEADLINE_S)
            return Final(Phase.UNCONFIRMED, reason.noted(MAY_BE_TURNING))
        if order.is_written:
            reason = Reason(ResultCode.NOT_SEEN, "release" if order.is_own else "stop", within_s=DEADLINE_S)
            return Final(Phase.UNCONFIRMED, reason.noted(frames.babble, frames.refusal, MAY_BE_TURNING))
        if frames.refusal is not None:
            return Final(Phase.FAILED, frames.refusal.noted(MAY_BE_TURNING))
        return self._cut(order, Reason(ResultCode.LINE_DOWN, "stop"))

    def _cut(self, order: StopOrder, reason: Reason) -> Final:
        if order.is_written:
            return Final(Phase.UNCONFIRMED, reason.noted(Note("stop_written_before"), MAY_BE_TURNING))
        phase = Phase.FAILED if reason.code == ResultCode.INTERNAL else Phase.REJECTED
        return Final(phase, reason.noted(MAY_BE_TURNING))
