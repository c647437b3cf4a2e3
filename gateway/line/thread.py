"""The lines' own thread: nothing the rest of the gateway does may hold up a frame."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import sys
import threading
from collections.abc import Callable, Coroutine, Sequence
from dataclasses import dataclass, field
from functools import partial
from math import inf
from typing import Any

from gateway.line.client import LineClient, LocalLineClient, settled
from gateway.line.events import LineListener, OnFrame
from gateway.line.line import Line
from gateway.line.loop_bridge import CarriedListener, LoopBridge
from gateway.line.port.base import ClosesLate, PortOpener
from gateway.line.port.event_loop import new_precise_loop
from gateway.line.rtu.outcome import Outcome, Silent
from gateway.line.rtu.timeouts import ALLOWANCE_S
from gateway.line.scheduler.requests import Poll, Priority
from gateway.modbus.pdu import Request
from gateway.modbus.timing import LineTiming
from gateway.system.gc_tuning import TunedCollector
from gateway.system.loop_lag import LagMeter

RESTART_PAUSE_S = 1.0  # after a bug has ended a line's loop
STOP_WITHIN_S = 3.0  # of the 10 s in which the gateway ends; the longest transaction takes less
FIGURES_EVERY_S = 1.0
SWITCH_INTERVAL_S = 0.0001  # Python's 5 ms are two silences: too long to wait for the app's thread

logger = logging.getLogger(__name__)


@dataclass(slots=True, eq=False)
class _Hosted:
    """One line in the thread."""

    scheduler: Line
    opener: PortOpener
    listener: CarriedListener
    crashes: int = 0
    figures: dict[str, Any] = field(default_factory=dict)
    task: asyncio.Task[None] | None = None  # of the lines' loop, once it has begun

    def note_figures(self) -> None:
        self.figures = {"crashes": self.crashes, **self.scheduler.figures()}


class LineHost:
    """Runs every line in one thread with a loop of its own; its methods belong to the app's loop.

    The listener is called on the app's loop, in the order in which things happened.
    """

    def __init__(self, listener: LineListener) -> None:
        self.lag = LagMeter()  # of the lines' loop
        self._listener = listener
        self._courier = LoopBridge()
        self._collector = TunedCollector()
        self._lines: dict[str, _Hosted] = {}
        self._ending: set[asyncio.Task[None]] = set()  # of lines that were removed; of the lines' loop
        self._on_frame: OnFrame | None = None
        self._thread: threading.Thread | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
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
        listener = CarriedListener(self._listener, self._courier)
        scheduler = Line(
            name=name,
            opener=opener,
            timing=timing,
            polls=polls,
            listener=listener,
            allowance_s=allowance_s,
            seed=seed,
            deaf_after_s=deaf_after_s,
            hurry=self._courier.flush,
        )
        hosted = self._lines[name] = _Hosted(scheduler, opener, listener)
        hosted.note_figures()
        scheduler.capture(self._on_frame)
        if self._loop is not None:
            self.to_line(lambda: self._begin(hosted))
        return _HostedLineClient(hosted, self)

    def remove_line(self, name: str) -> Coroutine[Any, Any, object]:
        """End a line, of which nothing is told from now on; what is returned waits until its port is closed.

        The transaction under way is not cut.
        """
        hosted = self._lines.pop(name)
        hosted.listener.mute()
        ended = asyncio.Event()
        self.to_line(lambda: self._end(hosted, ended))
        return ended.wait()

    async def start(self) -> None:
        """Start the thread; returns once its loop takes calls."""
        self._courier.loop = asyncio.get_running_loop()
        self._collector.spare()
        self._stopping = asyncio.Event()
        started = threading.Event()
        self._thread = threading.Thread(target=self._run_thread, args=(started,), name="lines", daemon=True)
        self._thread.start()
        await asyncio.to_thread(started.wait)

    async def stop(self) -> None:
        """Let each transaction under way end, close the ports and end the thread.

        A port that does not close (a driver that hangs) is waited for `STOP_WITHIN_S` at most.
        """
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
        return {name: hosted.scheduler.progress for name, hosted in self._lines.items()}

    def capture(self, on_frame: OnFrame | None) -> None:
        """Hand on every frame of every line from now on, on the app's loop; None: no more."""
        self._on_frame = None if on_frame is None else partial(self._carry_frame, on_frame)
        for hosted in self._lines.values():
            self.to_line(partial(hosted.scheduler.capture, self._on_frame))

    def is_running(self) -> bool:
        """Return whether the lines' loop takes calls."""
        return self._thread is not None

    def to_line(self, call: Callable[[], object]) -> None:
        """Have something done on the lines' loop, in order; at once while there is none."""
        if self._loop is None:
            call()
            return
        with contextlib.suppress(RuntimeError):  # the loop has just been closed: nothing is left to do
            self._loop.call_soon_threadsafe(call)

    def to_app(self, call: Callable[[], object]) -> None:
        """Have something done on the app's loop, in order."""
        self._courier.post(call)

    def _carry_frame(self, on_frame: OnFrame, line: str, at_s: float, direction: str, frame: bytes) -> None:
        self._courier.post_soon(lambda: on_frame(line, at_s, direction, frame))

    def _run_thread(self, started: threading.Event) -> None:
        sys.setswitchinterval(SWITCH_INTERVAL_S)
        with asyncio.Runner(loop_factory=lambda: new_precise_loop(self.lag.note)) as runner:
            runner.run(self._main(started))

    async def _main(self, started: threading.Event) -> None:
        """Run all lines until asked to stop."""
        self._loop = asyncio.get_running_loop()
        for hosted in tuple(self._lines.values()):
            self._begin(hosted)
        keeping = asyncio.create_task(self._keep_figures(), name="figures")
        started.set()
        await self._stopping.wait()
        begun = (hosted.task for hosted in tuple(self._lines.values()))
        tasks = [keeping, *self._ending, *(task for task in begun if task is not None)]
        for task in tasks:
            task.cancel()
        await asyncio.wait(tasks)
        self._courier.flush()

    def _begin(self, hosted: _Hosted) -> None:
        """Run a line, once its port cannot be in the hands of one that was removed."""
        work = self._supervise(hosted, tuple(self._ending))
        hosted.task = asyncio.get_running_loop().create_task(work, name=f"supervise {hosted.scheduler.name}")

    def _end(self, hosted: _Hosted, ended: asyncio.Event) -> None:
        """End a line that was removed; `ended` belongs to the app's loop."""
        task = hosted.task
        if task is None or task.done():  # there is no thread
            ended.set()
            return
        self._ending.add(task)
        task.add_done_callback(self._ending.discard)
        task.add_done_callback(lambda _: self.to_app(ended.set))
        task.cancel()

    async def _supervise(self, hosted: _Hosted, earlier: Sequence[asyncio.Task[None]]) -> None:
        """Run one line; whatever ends it is a bug that the other lines must not feel."""
        scheduler = hosted.scheduler
        if earlier:
            await asyncio.wait(earlier)
        try:
            while True:
                try:
                    await scheduler.run()
                except Exception:  # the one guard at this task's top
                    hosted.crashes += 1
                    logger.exception("line=%s crashed, starts again", scheduler.name)
                await asyncio.sleep(RESTART_PAUSE_S)
        finally:
            if isinstance(hosted.opener, ClosesLate):
                await hosted.opener.wait_closed()

    async def _keep_figures(self) -> None:
        while True:
            self._note_figures()
            await asyncio.sleep(FIGURES_EVERY_S)

    def _note_figures(self) -> None:
        for hosted in tuple(self._lines.values()):
            hosted.note_figures()


class _HostedLineClient(LocalLineClient):
    """A LineClient of a scheduler in the lines' thread."""

    def __init__(self, hosted: _Hosted, host: LineHost) -> None:
        super().__init__(hosted.scheduler)
        self._hosted = hosted
        self._host = host

    def transact(
        self, unit: int, request: Request, *, response_time_s: float, lane: Priority, until_s: float = inf
    ) -> asyncio.Future[Outcome]:
        """Hand a request to the line; without a running line nothing is sent."""
        if not self._host.is_running():
            return settled(Silent("port closed", is_sent=False))
        return super().transact(unit, request, response_time_s=response_time_s, lane=lane, until_s=until_s)

    def figures(self) -> dict[str, Any]:
        """Return the line's counters and times, and its crashes, at most about a second old."""
        return self._hosted.figures

    def _to_line(self, call: Callable[[], object]) -> None:
        self._host.to_line(call)

    def _to_app(self, call: Callable[[], object]) -> None:
        self._host.to_app(call)
