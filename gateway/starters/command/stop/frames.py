"""The frames of one starter's stop: when one is sent, in which words, and what came of them.

1. Each stop message has a frame of its own, handed to the line before anything else is done about it.
   Beyond `OWN_FRAMES` of one starter, messages that come within 0.1 s share the next frame.
2. A frame follows the one before after 0.5 s, whatever came of the read-backs, as long as one is needed.
3. A command word is written whole only when it was read in the last `DECIDES_FOR_S`; else its bits of motion
   are cleared by mask. A starter that does not know this function gets the word read last, however old.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from gateway.contract import Note, Reason
from gateway.families import Procedure, WriteStep, command
from gateway.line import Answered, Garbled, Outcome, Priority, Refused, Silent
from gateway.modbus import ExceptionCode, Function, MaskWriteRegister
from gateway.starters.command.addressee import StopAddressee
from gateway.starters.command.wire import DECIDES_FOR_S, Wire, refusal_of
from gateway.system.rate_limits import Bucket, Rate

logger = logging.getLogger(__name__)

REPEAT_S = 0.5
OWN_FRAMES = Rate(10.0, 8)  # for messages of one starter: so many a second, so many at once
SHARED_WITHIN_S = 0.1  # after the frame before: when the frame of messages beyond that is sent

Asked = Sequence[asyncio.Future[Outcome]]


@dataclass(eq=False)
class Frames:
    """Sends the frames of one starter's stop.

    `next_lane` says whether one more is needed, and how soon. `on_left` is called with the number of a frame
    that may have reached the starter, and `is_acknowledged`.
    """

    starter: StopAddressee
    wire: Wire
    next_lane: Callable[[], Priority | None]
    on_left: Callable[..., None]

    def __post_init__(self) -> None:
        self._own = Bucket(OWN_FRAMES)
        self.with_jog = False  # jog = 0 is a part of each frame: a jog may stand that was not seen
        self.families: list[str] = []  # in whose words frames were sent
        self.refusal: Reason | None = None  # the latest
        self.is_answered = False  # the starter answered anything at all
        self.babble: Note | None = None  # of a line that was not quiet when a frame was sent
        self.handed = 0  # frames handed to the line
        self._due_s = 0.0  # when the next frame is due
        self._timer: asyncio.TimerHandle | None = None
        self._under_way: set[asyncio.Task[None]] = set()  # frames that wait for the line or their answer
        self._is_mask_refused = False  # the starter does not know the function that clears single bits

    def ask(self) -> int:
        """Have a frame sent for one more message; return its number."""
        if self._own.take(self.wire.now_s()):
            self._send(Priority.STOP)
            return self.handed
        self._plan(min(self._due_s, self.wire.now_s() + SHARED_WITHIN_S))
        return self.handed + 1

    def procedure(self) -> Procedure:
        """Return what stops the starter."""
        starter, seen = self.starter, self.starter.snapshot.rows
        if Function.MASK_WRITE_REGISTER in starter.profile.limits.functions and not self._is_mask_refused:
            fresh = starter.snapshot.rows_since(self.wire.now_s() - DECIDES_FOR_S)
            # The device shows only a part of the word: without its status the rest is not known.
            words = {*starter.profile.command_word, starter.profile.status_word}
            seen = fresh if fresh.keys() >= words else {}
        return command.stop(starter.profile, starter.variant, seen=seen, with_jog=self.with_jog)

    def send_if_due(self) -> None:
        """Send the next frame at its time, unless one is still under way or none is needed."""
        lane = None if self.wire.now_s() < self._due_s or self._under_way else self.next_lane()
        if lane is not None:
            self._send(lane)

    def close(self) -> None:
        """Send no frame any more; one that is under way may have left."""
        if self._timer is not None:
            self._timer.cancel()
        if self._under_way:
            self.on_left(self.handed, is_acknowledged=False)

    def _send(self, lane: Priority) -> None:
        """Hand one frame to the line."""
        self.handed += 1
        self._plan(self.wire.now_s() + REPEAT_S)
        if self.starter.profile.family not in self.families:
            self.families.append(self.starter.profile.family)
        try:
            steps = self.procedure().steps
            asked = [self.wire.hand_over(step.request, lane=lane) for step in steps]
        except Exception:  # whatever it is, the read-back meets it again and ends the commands
            logger.exception("starter=%s stop not sent", self.starter.name)
            return
        frame = asyncio.get_running_loop().create_task(self._follow(self.handed, steps, asked))
        self._under_way.add(frame)
        frame.add_done_callback(self._under_way.discard)

    def _plan(self, due_s: float) -> None:
        self._due_s = due_s
        if self._timer is not None:
            self._timer.cancel()
        self._timer = asyncio.get_running_loop().call_at(due_s, self.send_if_due)

    async def _follow(self, number: int, steps: Sequence[WriteStep], asked: Asked) -> None:
        """Record what came of a frame; what was cut short may have been on its way."""
        await asyncio.wait(asked)
        outcomes = [None if each.cancelled() else each.result() for each in asked]
        if any(outcome is not None and outcome.is_over_babble for outcome in outcomes):
            self.babble = Note("over_babble")
        self.is_answered |= any(isinstance(outcome, (Answered, Refused)) for outcome in outcomes)
        # A jog = 0 may be refused where no jog is set up.
        pairs = list(zip(steps, outcomes, strict=True))
        counting = [each for step, each in pairs if not (step.may_be_refused and isinstance(each, Refused))]
        for each in counting:
            if isinstance(each, Refused):
                self.refusal = refusal_of(self.starter.profile, each.code)
        if not self._is_mask_refused and any(_is_mask_refused(*pair) for pair in pairs):
            self._is_mask_refused = True
            if self.procedure().steps != steps:  # the word read last goes out at once, where there is one
                self._plan(self.wire.now_s())
        if self._is_mask_refused or any(_may_have_left(each) for each in counting):
            is_acknowledged = all(isinstance(each, Answered) for each in counting)
            self.on_left(number, is_acknowledged=is_acknowledged)
        asyncio.get_running_loop().call_soon(self.send_if_due)  # once this frame is no longer under way


def _may_have_left(outcome: Outcome | None) -> bool:
    """Return whether a request may have reached its starter, as one that was cut short may have."""
    if isinstance(outcome, Silent | Garbled):
        return outcome.is_sent
    return not isinstance(outcome, Refused)


def _is_mask_refused(step: WriteStep, outcome: Outcome | None) -> bool:
    """Return whether a starter does not know the function that clears single bits."""
    is_refused = isinstance(outcome, Refused) and outcome.code == ExceptionCode.ILLEGAL_FUNCTION
    return is_refused and isinstance(step.request, MaskWriteRegister)
