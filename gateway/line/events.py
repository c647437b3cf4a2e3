"""What a line tells the floor above: answers to polls, units that come and go, the port.

What a line tells the floor above: at a moment when the line does not wait for us.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any, Protocol

from gateway.line.rtu.bus_faults import BusFault
from gateway.line.rtu.outcome import Answered, Garbled, Outcome, Silent
from gateway.line.rtu.trace import Trace
from gateway.line.scheduler.requests import Job, Poll


class LineListener(Protocol):
    """Hears of one or more lines; every call must return at once and must not raise.

    The scheduler calls it on the line's loop; `LineHost` carries the calls over to the app's loop, in order.
    """

    def on_poll(self, line: str, key: str, unit: int, outcome: Outcome) -> None:
        """Hear what became of the poll `key`; a garbled reply is told only when repeating did not help."""
        ...

    def on_unit(self, line: str, unit: int, is_answering: bool, reason: str, frames: tuple[str, ...]) -> None:  # noqa: FBT001 - the seam's exact shape
        """Hear that a unit began to answer or went silent; `frames` are the line's last, oldest first."""
        ...

    def on_trouble(self, line: str, code: str, unit: int, text: str, frames: tuple[str, ...]) -> None:
        """Hear what is wrong on the line (`suspicion.py` has the codes); unit 0 is someone unknown."""
        ...

    def on_port(self, line: str, is_open: bool, reason: str) -> None:  # noqa: FBT001 - the seam's exact shape
        """Hear that the port was opened or is away; told once per change of state or reason."""
        ...


OnFrame = Callable[[str, float, str, bytes], None]  # line, then as `trace.Tap`

logger = logging.getLogger(__name__)


class Notifications:
    """Speaks for one line; what happened in a turn is told in order, once the next request is on its way.

    What others do with an answer would else take the interpreter while the silence runs out.
    """

    def __init__(
        self, name: str, listener: LineListener, trace: Trace, *, hurry: Callable[[], None] | None = None
    ) -> None:
        self._hurry = hurry  # called when what was told before must not wait
        self._said: dict[str, Any] = {}  # the latest answers to urgent polls, by their keys
        self._name = name
        self._listener = listener
        self._trace = trace
        self._waiting: list[Callable[[], None]] = []
        self._told_port: tuple[bool, str] | None = None

    def flush(self) -> None:
        """Tell what waits to be told."""
        while self._waiting:
            self._waiting.pop(0)()

    def finish(self, job: Job, outcome: Outcome) -> None:
        """Tell whoever waits for a job, soon."""
        self._waiting.append(lambda: job.finish(outcome))

    def tell_poll(self, poll: Poll, outcome: Outcome) -> None:
        """Tell what became of a poll, soon."""
        self._waiting.append(lambda: self._listener.on_poll(self._name, poll.key, poll.unit, outcome))
        if poll.is_urgent and self._hurry is not None and isinstance(outcome, Answered):
            if self._said.get(poll.key) != outcome.value:
                self._waiting.append(self._hurry)
            self._said[poll.key] = outcome.value

    def tell_unit(self, unit: int, outcome: Outcome, *, is_answering: bool) -> None:
        """Tell that a unit began to answer or went silent, soon, with the frames up to now."""
        frames = self._trace.frames()
        reason = outcome.reason if isinstance(outcome, Silent | Garbled) else "answers"

        def tell() -> None:
            self._listener.on_unit(self._name, unit, is_answering, reason, frames)

        self._waiting.append(tell)

    def tell_trouble(self, trouble: BusFault) -> None:
        """Tell what is wrong on the line, soon, with the frames that showed it."""
        frames = self._trace.frames()

        def tell() -> None:
            self._listener.on_trouble(self._name, trouble.code, trouble.unit, trouble.text, frames)

        self._waiting.append(tell)

    def capture(self, on_frame: OnFrame | None) -> None:
        """Hand on every frame from now on; None: no more."""
        if on_frame is None:
            self._trace.tap = None
            return

        def tap(at_s: float, direction: str, frame: bytes) -> None:
            self._waiting.append(lambda: on_frame(self._name, at_s, direction, frame))

        self._trace.tap = tap

    def tell_port(self, reason: str, *, is_open: bool) -> None:
        """Tell a change of the port's state, or of the reason why it is away, once and now."""
        if self._told_port == (is_open, reason):
            return
        self.flush()
        self._told_port = (is_open, reason)
        self._listener.on_port(self._name, is_open, reason)
