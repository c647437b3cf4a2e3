"""The lines' own thread: nothing the rest of the gateway does may hold up a frame."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import sys
import threading
from collections.abc import Callable, Coroutine, Sequence
from dataclasses import dataclass, field
from typing import Any

from gateway.line.client import LineClient
from gateway.line.events import EventQueue, FrameSeen, LineEvent, LineEvents, OnFrame, deliver
from gateway.line.line import Line
from gateway.line.port.base import ClosesLate, PortOpener
from gateway.line.port.event_loop import new_precise_loop
from gateway.line.rtu.transaction import ALLOWANCE_S
from gateway.line.scheduler.requests import Poll
from gateway.modbus import LineTiming
from gateway.system.gc_tuning import TunedCollector
from gateway.system.stalls import LagMeter

RESTART_PAUSE_S = 1.0  # after a bug has ended a line's loop
STOP_WITHIN_S = 3.0  # of the 10 s in which the gateway ends; the longest transaction takes less
STATISTICS_EVERY_S = 1.0
SWITCH_INTERVAL_S = 0.0001  # Python's 5 ms are two silences: too long to wait for the app's thread

logger = logging.getLogger(__name__)


@dataclass(slots=True, eq=False)
class _Hosted:
    """One line in the thread."""

    line: Line
    opener: PortOpener
    crashes: int = 0
    statistics: dict[str, Any] = field(default_factory=dict)
    task: asyncio.Task[None] | None = None  # of the lines' loop, once it has begun

    def note_statistics(self) -> None:
        self.statistics = {"crashes": self.crashes, **self.line.statistics()}


class LineHost:
    """Runs every line in one thread with a loop of its own; its methods belong to the app's loop.

    `handle` is given each event on the app's loop, in the order in which things happened. Without a thread
    the lines share that loop.
    """

    def __init__(self, handle: Callable[[LineEvent], None], *, has_thread: bool = True) -> None:
        self.lag = LagMeter()  # of the lines' loop
        self._handle = handle
        self._events = EventQueue(self._hand_over)
        self._collector = TunedCollector()
        self._lines: dict[str, _Hosted] = {}
        self._ending: set[asyncio.Task[None]] = set()  # of lines that were removed; of the lines' loop
        self._on_frame: OnFrame | None = None
        self._has_thread = has_thread
        self._thread: threading.Thread | None = None
        self._serving: asyncio.Task[None] | None = None  # instead of the thread
        self._loop: asyncio.AbstractEventLoop | None = None  # the lines'
        self._app: asyncio.AbstractEventLoop | None = None
        self._stopping = asyncio.Event()  # belongs to the lines' loop

    def add_line(
        self,
        *,
        name: str,
        opener: PortOpener,
        timing: LineTiming,
        polls: Sequence[Poll],
        allowance_s: float = ALLOWANCE_S,
        seed: int = 0,
        deaf_after_s: float | None = None,
    ) -> LineClient:
        """Add a line, which begins with `start`, or at once: as soon as those removed before have ended."""
        line = Line(
            name=name,
            opener=opener,
            timing=timing,
            polls=polls,
            events=self._events,
            allowance_s=allowance_s,
            seed=seed,
            deaf_after_s=deaf_after_s,
        )
        hosted = self._lines[name] = _Hosted(line, opener)
        hosted.note_statistics()
        line.events.capture(is_on=self._on_frame is not None)
        if self._loop is not None:
            self.to_line(self._begin, hosted)
        return LineClient(line, self._post, lambda: hosted.statistics)

    def remove_line(self, name: str) -> Coroutine[Any, Any, object]:
        """End a line, of which nothing is handled from now on; what is returned waits for its port's end.

        The transaction under way is not cut.
        """
        hosted = self._lines.pop(name)
        hosted.line.events.is_muted = True
        ended = asyncio.Event()
        self.to_line(self._end, hosted, ended)
        return ended.wait()

    async def start(self) -> None:
        """Start the thread; returns once its loop takes calls."""
        self._app = asyncio.get_running_loop()
        self._collector.spare()
        self._stopping = asyncio.Event()
        started = threading.Event()
        if not self._has_thread:
            self._loop = self._app
            self._serving = asyncio.create_task(self._main(started), name="lines")
            return
        self._thread = threading.Thread(target=self._run_thread, args=(started,), name="lines", daemon=True)
        self._thread.start()
        await asyncio.to_thread(started.wait)

    async def stop(self) -> None:
        """Let each transaction under way end, close the ports and end the thread.

        A port that does not close (a driver that hangs) is waited for `STOP_WITHIN_S` at most.
        """
        serving, self._serving = self._serving, None
        if serving is not None:
            self._stopping.set()
            await serving
            self._loop = None
        thread, self._thread = self._thread, None
        if thread is None:
            return
        self.to_line(self._stopping.set)
        await asyncio.to_thread(thread.join, STOP_WITHIN_S)
        if thread.is_alive():
            logger.error("the lines did not end within %g s: a port hangs", STOP_WITHIN_S)
        self._loop = None
        self._collector.end()

    def progress(self) -> dict[str, int]:
        """Return each line's count of steps; one that stands still for long is stuck."""
        return {name: hosted.line.progress for name, hosted in self._lines.items()}

    def capture(self, on_frame: OnFrame | None) -> None:
        """Hand on every frame of every line from now on, on the app's loop; None: stop."""
        self._on_frame = on_frame
        is_on = on_frame is not None
        for hosted in self._lines.values():
            self.to_line(lambda events: events.capture(is_on=is_on), hosted.line.events)

    def to_line(self, call: Callable[..., object], *args: object) -> None:
        """Have something done on the lines' loop, in order; at once while there is none."""
        if self._loop is None:
            call(*args)
            return
        with contextlib.suppress(RuntimeError):  # the loop has just been closed: nothing is left to do
            self._loop.call_soon_threadsafe(call, *args)

    def _post(self, call: Callable[..., object], *args: object) -> bool:
        """Do as `to_line`, unless the lines end or have ended: what comes then might not be done any more."""
        if self._thread is None and self._serving is None and self._app is not None:
            return False
        self.to_line(call, *args)
        return True

    def _hand_over(self, batch: Sequence[tuple[LineEvents, LineEvent]]) -> None:
        self._to_app(deliver, batch, self._take)

    def _to_app(self, call: Callable[..., object], *args: object) -> None:
        if self._app is None:
            call(*args)
            return
        with contextlib.suppress(RuntimeError):  # the app's loop is closed: there is nothing left to inform
            self._app.call_soon_threadsafe(call, *args)

    def _take(self, event: LineEvent) -> None:
        """Handle an event on the app's loop."""
        if isinstance(event, FrameSeen):
            if self._on_frame is not None:
                self._on_frame(event.line, event.at_s, event.direction, event.frame)
        else:
            self._handle(event)

    def _run_thread(self, started: threading.Event) -> None:
        sys.setswitchinterval(SWITCH_INTERVAL_S)
        with asyncio.Runner(loop_factory=lambda: new_precise_loop(self.lag.note)) as runner:
            runner.run(self._main(started))

    async def _main(self, started: threading.Event) -> None:
        """Run all lines until asked to stop."""
        self._loop = asyncio.get_running_loop()
        for hosted in tuple(self._lines.values()):
            self._begin(hosted)
        noting = asyncio.create_task(self._note_statistics_repeatedly(), name="statistics")
        started.set()
        await self._stopping.wait()
        begun = (hosted.task for hosted in tuple(self._lines.values()))
        tasks = [noting, *self._ending, *(task for task in begun if task is not None)]
        for task in tasks:
            task.cancel()
        await asyncio.wait(tasks)
        self._events.hand_over()

    def _begin(self, hosted: _Hosted) -> None:
        """Run a line, once its port cannot be in the hands of one that was removed."""
        work = self._supervise(hosted, tuple(self._ending))
        hosted.task = asyncio.get_running_loop().create_task(work, name=f"supervise {hosted.line.name}")

    def _end(self, hosted: _Hosted, ended: asyncio.Event) -> None:
        """End a line that was removed; `ended` belongs to the app's loop."""
        task = hosted.task
        if task is None or task.done():  # there is no thread
            ended.set()
            return
        self._ending.add(task)
        task.add_done_callback(self._ending.discard)
        task.add_done_callback(lambda _: self._to_app(ended.set))
        task.cancel()

    async def _supervise(self, hosted: _Hosted, earlier: Sequence[asyncio.Task[None]]) -> None:
        """Run one line; whatever ends it is a bug that the other lines must not feel."""
        line = hosted.line
        if earlier:
            await asyncio.wait(earlier)
        try:
            while True:
                try:
                    await line.run()
                except Exception:  # the one guard at this task's top
                    hosted.crashes += 1
                    logger.exception("line=%s crashed, starts again", line.name)
                await asyncio.sleep(RESTART_PAUSE_S)
        finally:
            if isinstance(hosted.opener, ClosesLate):
                await hosted.opener.wait_closed()

    async def _note_statistics_repeatedly(self) -> None:
        while True:
            for hosted in tuple(self._lines.values()):
                hosted.note_statistics()
            await asyncio.sleep(STATISTICS_EVERY_S)
