"""Events on the lines, as data: appended on the lines' thread, handled on the app's.

1. The events of a transaction are appended to one list, in order.
2. The list is handed over once the next request is on the wire: the app's thread would else take the
   interpreter while the silence runs out.
3. Results of polls may wait `POLLS_WAIT_S` for more: to wake the app's thread for each costs processor
   time. All else goes at once, and takes along what waits before it.
"""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from gateway.line.rtu.bus_faults import BusFault
from gateway.line.rtu.transaction import Answered, Garbled, Outcome, Silent
from gateway.line.scheduler.requests import Job, Poll

POLLS_WAIT_S = 0.1
LONGEST_SHOWN = 256  # bytes, the longest frame; a flood is longer

logger = logging.getLogger(__name__)


class PollResult(NamedTuple):
    """The outcome of a poll; a garbled reply only when repeating did not help."""

    line: str
    key: str
    unit: int
    outcome: Outcome


@dataclass(frozen=True, slots=True)
class UnitChanged:
    """A unit began to answer or went silent."""

    line: str
    unit: int
    is_answering: bool
    reason: str
    frames: tuple[str, ...] = ()  # the line's last, oldest first


@dataclass(frozen=True, slots=True)
class LineFault:
    """A fault of a line, with its last frames."""

    line: str
    fault: BusFault
    frames: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class PortChanged:
    """A port was opened or is away; once for each change of state or reason."""

    line: str
    is_open: bool
    reason: str


@dataclass(frozen=True, slots=True)
class JobDone:
    """The outcome of a job; `job.finish` is to be called with it, whatever the state of the line."""

    job: Job
    outcome: Outcome


@dataclass(frozen=True, slots=True)
class FrameSeen:
    """A frame on a line that is captured; direction as `RtuMaster` names it."""

    line: str
    at_s: float
    direction: str
    frame: bytes


OnFrame = Callable[[str, float, str, bytes], None]  # what a FrameSeen says

Tap = Callable[[float, str, bytes], None]  # the line's clock, direction, bytes

LineEvent = PollResult | UnitChanged | LineFault | PortChanged | JobDone | FrameSeen


class EventQueue:
    """The one list of all lines of a loop, to which it belongs; `hand_over` takes each batch."""

    def __init__(
        self,
        hand_over: Callable[[Sequence[tuple[LineEvents, LineEvent]]], None],
        *,
        polls_wait_s: float = POLLS_WAIT_S,
    ) -> None:
        self.events: list[tuple[LineEvents, LineEvent]] = []
        self.is_urgent = False
        self._hand_over = hand_over
        self._polls_wait_s = polls_wait_s
        self._timer: asyncio.TimerHandle | None = None

    def flush(self) -> None:
        """Hand over what there is, now or soon: the lines have a moment's time."""
        if not self.events:
            return
        if self.is_urgent or not self._polls_wait_s:
            self.hand_over()
        elif self._timer is None:
            self._timer = asyncio.get_running_loop().call_later(self._polls_wait_s, self.hand_over)

    def hand_over(self) -> None:
        """Hand over what there is, now."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        self.is_urgent = False
        if self.events:
            batch, self.events = self.events, []
            self._hand_over(batch)


class Trace:
    """The last frames of a line, for reports of what happened; each is also logged in hex at DEBUG."""

    def __init__(self, line: str, *, size: int = 16) -> None:
        self._line = line
        self._ring: deque[tuple[float, str, bytes]] = deque(maxlen=size)
        self._is_logged = logger.isEnabledFor(logging.DEBUG)
        self.tap: Tap | None = None  # is given every frame too

    def note(self, at_s: float, direction: str, frame: bytes) -> None:
        """Store a frame, or whatever came instead of one."""
        self._ring.append((at_s, direction, frame[:LONGEST_SHOWN]))
        if self.tap is not None:
            self.tap(at_s, direction, frame)
        if self._is_logged:
            logger.debug("line=%s %.6f %s %s", self._line, at_s, direction, frame.hex(" "))

    def frames(self) -> tuple[str, ...]:
        """Return the frames as text, oldest first: seconds on the line's clock, direction, hex."""
        return tuple(f"{at_s:.6f} {direction} {frame.hex(' ')}" for at_s, direction, frame in self._ring)


class LineEvents:
    """Appends the events of one line; `is_muted` belongs to those who handle them."""

    def __init__(self, name: str, queue: EventQueue, trace: Trace) -> None:
        self.is_muted = False
        self.flush = queue.flush
        self.trace = trace
        self._name = name
        self._queue = queue
        self._answers: dict[str, Any] = {}  # the latest to urgent polls, by their keys
        self._port: tuple[bool, str] | None = None

    def poll_done(self, poll: Poll, outcome: Outcome) -> None:
        """Append the result of a poll."""
        queue = self._queue
        queue.events.append((self, PollResult(self._name, poll.key, poll.unit, outcome)))
        if poll.is_urgent and isinstance(outcome, Answered) and self._answers.get(poll.key) != outcome.value:
            self._answers[poll.key] = outcome.value
            queue.is_urgent = True

    def job_done(self, job: Job, outcome: Outcome) -> None:
        """Append the end of a job."""
        self._append(JobDone(job, outcome))

    def unit_changed(self, unit: int, outcome: Outcome, *, is_answering: bool) -> None:
        """Append that a unit began to answer or went silent, with the frames up to now."""
        reason = outcome.reason if isinstance(outcome, Silent | Garbled) else "answers"
        self._append(UnitChanged(self._name, unit, is_answering, reason, self.trace.frames()))

    def fault(self, fault: BusFault) -> None:
        """Append what is wrong on the line, with the frames that showed it."""
        self._append(LineFault(self._name, fault, self.trace.frames()))

    def port_changed(self, reason: str, *, is_open: bool) -> None:
        """Append a change of the port's state, or of the reason why it is away; hand it over at once."""
        if self._port != (is_open, reason):
            self._port = (is_open, reason)
            self._append(PortChanged(self._name, is_open, reason))
            self._queue.hand_over()

    def capture(self, *, is_on: bool) -> None:
        """Append every frame from now on, or none any more."""
        self.trace.tap = self._frame_seen if is_on else None

    def _frame_seen(self, at_s: float, direction: str, frame: bytes) -> None:
        self._queue.events.append((self, FrameSeen(self._name, at_s, direction, frame)))

    def _append(self, event: LineEvent) -> None:
        self._queue.events.append((self, event))
        self._queue.is_urgent = True


def deliver(batch: Sequence[tuple[LineEvents, LineEvent]], handle: Callable[[LineEvent], None]) -> None:
    """Handle a batch in order, jobs here; of a line that is muted only its jobs."""
    for origin, event in batch:
        try:
            if isinstance(event, JobDone):
                event.job.finish(event.outcome)
            elif not origin.is_muted:
                handle(event)
        except Exception:  # a bug with one event must not cost the others
            logger.exception("event=%s failed", type(event).__name__)
