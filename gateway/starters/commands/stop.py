"""Stops one starter: frames before everything else, again and again, until read back or the time is up.

1. Each stop message has a frame of its own, handed to the line before anything else is done about it.
   Beyond `OWN_FRAMES` of one starter, messages that come within 0.1 s share the next frame.
2. A frame follows the one before after 0.5 s, whatever became of the read-backs, until all are read back.
3. A message is confirmed by two readings in a row that were asked for after the frame which counts for it:
   its own, or the first after that which the starter acknowledged. An acknowledgement that may be of any of
   several frames counts if all of these were written since the message came. Without one, frames follow until
   the time is up; then the latest two readings since the first frame decide.
4. A reading that was lost says nothing, for `SEEN_WITHIN_S`; one that shows otherwise ends the row.
5. A command word is written whole only when it was read in the last `DECIDES_FOR_S`; else its bits of motion
   are cleared by mask. A starter that does not know this function gets the word read last, however old.

Of a group each member is stopped so on its own: `group_stop`.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from math import inf
from typing import Any, assert_never

from gateway.contract import STOP, CommandRequest, EventCode, Note, Phase, Reason, ResultCode
from gateway.families import Procedure, Read, WriteStep, command
from gateway.line import Answered, Garbled, Outcome, Priority, Refused, Silent
from gateway.modbus.codes import ExceptionCode, Function
from gateway.modbus.writes import MaskWriteRegister
from gateway.starters.commands.execution import DECIDES_FOR_S, MAY_BE_TURNING
from gateway.starters.commands.lifecycle import CommandReport, Final
from gateway.starters.commands.starter_io import (
    EQUAL_READINGS,
    READ_BACK_PAUSE_S,
    HaltedError,
    OverdueError,
    RefusedError,
    Rows,
    StarterIo,
)
from gateway.starters.commands.stop_family import StopAddressee
from gateway.starters.view import StarterControlView
from gateway.system.rate_limits import Bucket, Rate

logger = logging.getLogger(__name__)

DEADLINE_S = 10.0  # of each message
REPEAT_S = 0.5
OWN_FRAMES = Rate(10.0, 8)  # for messages of one starter: so many a second, so many at once
UNREAD_PAUSE_S = 0.5  # between two readings of a starter that did not answer the latest two
LAST_READING_S = 5.0  # after that a reading which waits for a full line is waited for no longer
SEEN_WITHIN_S = 2.0  # before its end, so that a stop counts as seen
SHARED_WITHIN_S = 0.1  # after the frame before: when the frame of messages beyond that is sent


@dataclass(slots=True, eq=False)
class _StopOrder:
    """One stop message."""

    report: CommandReport | None  # None: it gets no answer of its own
    frame: int  # the number of its own frame
    came_s: float
    counts_from: int | None = None  # the first reading that counts; None: its frame has not left yet
    is_taken: bool = False  # the starter acknowledged its frame, or a later one

    @property
    def until_s(self) -> float:
        return self.came_s + DEADLINE_S

    @property
    def is_written(self) -> bool:
        return self.counts_from is not None

    def note_written(self, acknowledged_since_s: float, *, next_reading: int) -> None:
        """Take note of a frame that left; until one is acknowledged an earlier start may yet act."""
        if self.is_taken:
            return
        if self.report is not None and not self.is_written:
            self.report.write()
        self.is_taken = acknowledged_since_s >= self.came_s
        if self.is_taken or self.counts_from is None:
            self.counts_from = next_reading


class Stopping:
    """One starter's stop under way; every stop message that comes meanwhile joins it."""

    def __init__(self, starter: StarterControlView) -> None:
        self._starter = StopAddressee(starter)
        self._starter_io = StarterIo(self._starter, read_back_lane=Priority.FOLLOW_UP)
        self._time = asyncio.get_running_loop().time
        self._own_frames = Bucket(OWN_FRAMES)
        self._orders: list[_StopOrder] = []
        self._unanswered: _StopOrder | None = None  # the latest message without an answer: it stands for all
        self._wanted = 0  # the number of the frame that the latest message counts on
        self._handed = 0  # frames handed to the line
        self._due_s = 0.0  # when the next frame is due
        self._timer: asyncio.TimerHandle | None = None
        self._under_way: set[asyncio.Task[None]] = set()  # frames that wait for the line or their answer
        self._news = asyncio.Event()  # one of them has left
        self._readings = 0  # begun
        self._unread = 0  # the latest of them in a row that were not answered
        self._good: list[int] = []  # the latest two readings in a row that show a stop,
        self._good_s = -inf  # when the last of them was there,
        self._shown: dict[str, Any] = {}  # and what it says
        self._refusal: RefusedError | None = None
        self._is_mask_refused = False  # the starter does not know the function that clears single bits
        self._is_answered = False  # the starter answered anything at all since
        self._spoken: list[str] = []  # the families in whose words frames were sent
        self._is_over_babble = False  # a frame was sent although the line was not quiet
        self._is_garbled = False  # something came instead of an answer to a frame

    def ask(self) -> None:
        """Have a frame sent for one more message, and see it through; it may then join with its command."""
        came_s = self._time()
        if self._own_frames.take(came_s):
            self._send(Priority.STOP)
        else:
            self._wanted = self._handed + 1
            self._plan(min(self._due_s, self._time() + SHARED_WITHIN_S))
        self._unanswered = _StopOrder(None, self._wanted, came_s)

    def join(self, report: CommandReport) -> None:
        """Take in the stop command, already accepted, for which `ask` was called; its end is reported."""
        came_s = self._time() if self._unanswered is None else self._unanswered.came_s
        self._unanswered = None  # which stood for this message, and for those before that get no answer
        self._orders.append(_StopOrder(report, self._wanted, came_s))
        report.before = self._starter.snapshot.good_values()

    def is_asked_for(self, request: CommandRequest) -> bool:
        """Return whether the same client's stop, whose answer would be the same, has joined.

        Only over MQTT do both read that answer on one topic: each request to the page has its own.
        """
        if request.id or request.correlation or request.source:
            return False
        joined = (order.report.request for order in self._orders if order.report)
        return any((each.client, each.id) == (request.client, request.id) for each in joined)

    @property
    def count(self) -> int:
        """Return how many stop commands have joined."""
        return len(self._orders)

    def halt(self, reason: Reason) -> None:
        """Let nothing more go out."""
        self._starter_io.halt(reason)

    async def run(self) -> None:
        """Stop the motor; never raises, and always ends every stop command that has joined."""
        try:
            await self._read_on()
        except HaltedError as error:
            self._cut_all(error.reason)
        except Exception:  # the guard at the task's top
            logger.exception("starter=%s stop ended by a bug", self._starter.setup.name)
            self._cut_all(Reason(ResultCode.INTERNAL))
        finally:
            self._starter_io.halt(Reason(ResultCode.SHUTTING_DOWN))
            if self._timer is not None:
                self._timer.cancel()

    # The frames

    def _send(self, lane: Priority) -> None:
        """Hand one frame to the line."""
        self._handed += 1
        self._wanted = max(self._wanted, self._handed)
        self._plan(self._time() + REPEAT_S)
        if self._starter.profile.family not in self._spoken:
            self._spoken.append(self._starter.profile.family)
        try:
            steps = self._procedure().steps
            asked = [self._starter_io.hand_over(step.request, lane=lane) for step in steps]
        except Exception:  # whatever it is, the read-back meets it again and ends the commands
            logger.exception("starter=%s stop not sent", self._starter.setup.name)
            self._news.set()
            return
        frame = asyncio.get_running_loop().create_task(self._follow(self._handed, steps, asked))
        self._under_way.add(frame)
        frame.add_done_callback(self._under_way.discard)

    def _plan(self, due_s: float) -> None:
        self._due_s = due_s
        if self._timer is not None:
            self._timer.cancel()
        self._timer = asyncio.get_running_loop().call_at(due_s, self._send_if_due)

    def _send_if_due(self) -> None:
        """Send the next frame at its time, unless one is still under way or none is needed."""
        if self._time() < self._due_s or self._under_way or not self._all():
            return
        is_asked_for = self._wanted > self._handed or any(not each.is_written for each in self._all())
        if is_asked_for or not self._good or not all(each.is_taken for each in self._all()):
            self._send(Priority.STOP if is_asked_for else Priority.FOLLOW_UP)

    async def _follow(
        self, number: int, steps: Sequence[WriteStep], asked: Sequence[asyncio.Future[Outcome]]
    ) -> None:
        """Take note of what became of a frame."""
        await asyncio.wait(asked)
        outcomes = [each.result() for each in asked if not each.cancelled()]
        self._is_over_babble |= any(outcome.is_over_babble for outcome in outcomes)
        self._is_garbled |= any(isinstance(outcome, Garbled) and outcome.is_sent for outcome in outcomes)
        self._is_answered |= any(isinstance(outcome, (Answered, Refused)) for outcome in outcomes)
        refusals = [outcome for outcome in outcomes if isinstance(outcome, Refused)]
        if refusals:
            self._refusal = RefusedError(refusals[0].code)
            self._note_mask_refused(steps, asked)
        if self._is_mask_refused or any(_may_have_left(each) for each in asked):
            self._note_written(number, min(map(_acknowledged_since_s, asked)))
        self._news.set()
        asyncio.get_running_loop().call_soon(self._send_if_due)  # once this frame is no longer under way

    def _note_mask_refused(
        self, steps: Sequence[WriteStep], asked: Sequence[asyncio.Future[Outcome]]
    ) -> None:
        """Send the word read last at once, where there is one, to a starter without function 22."""
        if self._is_mask_refused:
            return
        self._is_mask_refused = any(map(_is_mask_refused, steps, asked))
        if self._is_mask_refused and self._procedure().steps != steps:
            self._plan(self._time())

    def _note_written(self, number: int, acknowledged_since_s: float) -> None:
        for order in self._all():
            if order.frame <= number:
                order.note_written(acknowledged_since_s, next_reading=self._readings + 1)

    def _procedure(self) -> Procedure:
        """Return what stops the starter."""
        starter, seen = self._starter, self._starter.snapshot.rows
        if Function.MASK_WRITE_REGISTER in starter.profile.limits.functions and not self._is_mask_refused:
            fresh = starter.snapshot.rows_since(self._time() - DECIDES_FOR_S)
            seen = fresh if fresh.keys() >= set(starter.profile.command_word) else {}
        return command.build(starter.profile, starter.variant, STOP, {}, seen=seen)

    # The readings

    async def _read_on(self) -> None:
        """Read the starter back until every message has its end."""
        while self._all():
            if any(order.is_written for order in self._all()):
                self._readings += 1
                is_seen = await self._see_stopped()
                await asyncio.sleep(0)  # the readings are published before the results that rest on them
                self._end_what_is_over(is_seen=is_seen)
                self._send_if_due()
                await self._pause(READ_BACK_PAUSE_S if self._unread < EQUAL_READINGS else UNREAD_PAUSE_S)
            else:
                await self._wait_for_a_frame()
                self._procedure()  # what cannot be built cannot be sent
                self._end_what_is_over(is_seen=False)

    async def _pause(self, seconds: float) -> None:
        if self._all():
            await self._starter_io.pause(seconds)

    async def _wait_for_a_frame(self) -> None:
        self._news.clear()
        over_s = min(order.until_s for order in self._all())
        timer = asyncio.get_running_loop().call_at(over_s, self._news.set)
        try:
            await self._starter_io.wait_for(_until(self._news))
        finally:
            timer.cancel()

    async def _see_stopped(self) -> bool:
        """Return whether what was read shows that the motor stops, and record it."""
        expect = self._procedure().verify
        rows = None if expect is None else await self._read_in_time(expect.reads)
        self._unread = self._unread + 1 if rows is None else 0
        if expect is None or rows is None:
            return False
        self._is_answered, values = True, self._starter_io.values(rows)
        if not expect.is_met(values):
            self._good = []
            return False
        self._good = [*self._good, self._readings][-EQUAL_READINGS:]
        self._good_s, self._shown = self._time(), values
        return True

    async def _read_in_time(self, reads: Iterable[Read]) -> Rows | None:
        """Return what is read back; None when the first of the messages is over for too long."""
        self._starter_io.until_s = min(order.until_s for order in self._all()) + LAST_READING_S
        try:
            return await self._starter_io.read_back(reads)
        except OverdueError:
            return None
        finally:
            self._starter_io.until_s = inf

    def _end_what_is_over(self, *, is_seen: bool) -> None:
        """End the messages that are read back, and those whose time is up unless a stop was just seen."""
        ends: list[tuple[_StopOrder, Final]] = []
        for order in self._all():
            is_over = self._time() >= order.until_s
            if self._is_seen_to_stop(order) and (order.is_taken or is_over):
                reason = Reason(ResultCode.OK, "read_back").noted(self._over_babble())
                ends.append((order, Final(Phase.CONFIRMED, reason, after=_points(self._shown))))
            elif is_over and not is_seen:
                ends.append((order, self._unseen(order)))
        self._end(ends)

    def _is_seen_to_stop(self, order: _StopOrder) -> bool:
        """Return whether two readings in a row show a stop, and count for this message."""
        first = inf if order.counts_from is None else order.counts_from
        counting = [each for each in self._good if each >= first]
        return len(counting) == EQUAL_READINGS and self._time() - self._good_s <= SEEN_WITHIN_S

    # The ends

    def _all(self) -> list[_StopOrder]:
        return self._orders if self._unanswered is None else [*self._orders, self._unanswered]

    def _end(self, ends: Collection[tuple[_StopOrder, Final]]) -> None:
        """Give messages their ends; one event is published for all that are not confirmed."""
        note = self._starter.note(self._spoken)
        ends = [(order, end.noted(note)) for order, end in ends]
        for _, end in [each for each in ends if each[1].phase is not Phase.CONFIRMED][:1]:
            self._publish_unconfirmed(end)
        for order, end in ends:
            if order is self._unanswered:
                self._unanswered = None
            else:
                self._orders.remove(order)
            if order.report is not None:
                order.report.finish(end)

    def _cut_all(self, reason: Reason) -> None:
        if self._under_way:
            self._note_written(self._handed, -inf)  # it may have been on its way already
        self._end([(order, self._cut(order, reason)) for order in self._all()])

    def _unseen(self, order: _StopOrder) -> Final:
        """Return the end of a stop whose time is up."""
        if order.is_written and not self._is_answered and not self._is_over_babble:
            noise = Note("noise") if self._is_garbled else None
            reason = Reason(ResultCode.NO_ANSWER, "stop", within_s=DEADLINE_S)
            return Final(Phase.UNCONFIRMED, reason.noted(noise, MAY_BE_TURNING))
        refusal = None if self._refusal is None else self._refusal.reason
        if order.is_written:
            reason = Reason(ResultCode.NOT_SEEN, "stop", within_s=DEADLINE_S)
            return Final(Phase.UNCONFIRMED, reason.noted(self._over_babble(), refusal, MAY_BE_TURNING))
        if refusal is not None:
            return Final(Phase.FAILED, refusal.noted(MAY_BE_TURNING))
        return self._cut(order, Reason(ResultCode.LINE_DOWN, "stop"))

    def _cut(self, order: _StopOrder, reason: Reason) -> Final:
        if order.is_written:
            return Final(Phase.UNCONFIRMED, reason.noted(Note("stop_written_before"), MAY_BE_TURNING))
        phase = Phase.FAILED if reason.code == ResultCode.INTERNAL else Phase.REJECTED
        return Final(phase, reason.noted(MAY_BE_TURNING))

    def _over_babble(self) -> Note | None:
        """Return what a result says of a line that was never quiet."""
        return Note("over_babble") if self._is_over_babble else None

    def _publish_unconfirmed(self, end: Final) -> None:
        self._starter.emitter.event(
            EventCode.STOP_UNCONFIRMED, phase=end.phase, code=end.code, outcome=end.text
        )


def _may_have_left(asked: asyncio.Future[Outcome]) -> bool:
    """Return whether a request may have reached its starter; what was cut short may have been on its way."""
    if asked.cancelled():
        return True
    match asked.result():
        case Refused():
            return False
        case Answered():
            return True
        case Silent(is_sent=is_sent) | Garbled(is_sent=is_sent):
            return is_sent
        case _ as outcome:
            assert_never(outcome)


def _is_mask_refused(step: WriteStep, asked: asyncio.Future[Outcome]) -> bool:
    """Return whether a starter does not know the function that clears single bits."""
    if asked.cancelled() or not isinstance(step.request, MaskWriteRegister):
        return False
    outcome = asked.result()
    return isinstance(outcome, Refused) and outcome.code == ExceptionCode.ILLEGAL_FUNCTION


def _acknowledged_since_s(asked: asyncio.Future[Outcome]) -> float:
    """Return since when a write equal to this one was acknowledged: inf for itself, -inf for none."""
    match None if asked.cancelled() else asked.result():
        case Answered():
            return inf
        case Garbled(acknowledges_since_s=since_s):
            return since_s
        case _:
            return -inf


def _points(values: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in values.items() if not isinstance(value, tuple)}


async def _until(event: asyncio.Event) -> None:
    await event.wait()
