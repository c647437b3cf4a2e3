"""The lines' own thread: nothing the rest of the gateway does may hold up a frame."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import logging
import sys
import threading
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from gateway.lag import LagMeter
from gateway.line.budget import ALLOWANCE_S
from gateway.line.client import LineClient, LocalLineClient
from gateway.line.job import Lane, Poll
from gateway.line.listener import LineListener
from gateway.line.outcome import Outcome, Silent
from gateway.line.port import PortOpener
from gateway.line.precise_selector import new_precise_loop
from gateway.line.scheduler import Scheduler
from gateway.line.voice import OnFrame
from gateway.modbus.pdu import Request
from gateway.modbus.timing import LineTiming
from gateway.repetition import Repetition

RESTART_PAUSE_S = 1.0  # after a bug has ended a line's loop
FIGURES_EVERY_S = 1.0
SOON_S = 0.04  # for answers to polls on their way to the app's loop
SWITCH_INTERVAL_S = 0.0005  # Python's 5 ms are two silences: too long to wait for the app's thread

logger = logging.getLogger(__name__)


class LineHost:
    """Runs every line in one thread with a loop of its own; its methods belong to the app's loop.

    The listener is called on the app's loop, in the order in which things happened.
    """

    def __init__(self, listener: LineListener) -> None:
        self.lag = LagMeter()  # of the lines' loop
        self._listener = listener
        self._courier = _Courier()
        self._schedulers: list[Scheduler] = []
        self._figures: dict[str, dict[str, Any]] = {}
        self._crashes: dict[str, int] = {}
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
        """Add a line; only before `start`."""
        scheduler = Scheduler(
            name=name,
            opener=opener,
            timing=timing,
            polls=polls,
            listener=_CarriedListener(self._listener, self._courier),
            allowance_s=allowance_s,
            seed=seed,
            deaf_after_s=deaf_after_s,
        )
        self._schedulers.append(scheduler)
        self._crashes[name] = 0
        self._note_figures()
        return _HostedLineClient(scheduler, self)

    async def start(self) -> None:
        """Start the thread; returns once its loop takes calls."""
        self._courier.loop = asyncio.get_running_loop()
        gc.collect()
        gc.freeze()  # what lives as long as the gateway is not looked through again and again
        self._stopping = asyncio.Event()
        started = threading.Event()
        self._thread = threading.Thread(target=self._run_thread, args=(started,), name="lines", daemon=True)
        self._thread.start()
        await asyncio.to_thread(started.wait)

    async def stop(self) -> None:
        """Let each transaction under way end, close the ports and end the thread."""
        thread, self._thread = self._thread, None
        if thread is None:
            return
        self.to_line(self._stopping.set)
        await asyncio.to_thread(thread.join)
        self._loop = None
        gc.unfreeze()

    def progress(self) -> dict[str, int]:
        """Return each line's count of steps; one that stands still for long is stuck."""
        return {scheduler.name: scheduler.progress for scheduler in self._schedulers}

    def figures(self, name: str) -> dict[str, Any]:
        """Return a line's figures, at most about a second old, with the number of its crashes."""
        return self._figures[name]

    def capture(self, on_frame: OnFrame | None) -> None:
        """Hand on every frame of every line from now on, on the app's loop; None: no more."""
        carried: OnFrame | None = None
        if on_frame is not None:
            carried = partial(self._carry_frame, on_frame)
        for scheduler in self._schedulers:
            self.to_line(partial(scheduler.capture, carried))

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
        tasks = [
            asyncio.create_task(self._supervise(scheduler), name=f"supervise {scheduler.name}")
            for scheduler in self._schedulers
        ]
        tasks.append(asyncio.create_task(self._keep_figures(), name="figures"))
        started.set()
        await self._stopping.wait()
        for task in tasks:
            task.cancel()
        await asyncio.wait(tasks)
        self._courier.flush()

    async def _supervise(self, scheduler: Scheduler) -> None:
        """Run one line; whatever ends it is a bug that the other lines must not feel."""
        repetition = Repetition()
        while True:
            try:
                await scheduler.run()
            except Exception as error:  # the one guard at this task's top
                self._crashes[scheduler.name] += 1
                if repetition.is_news(error):
                    logger.exception("line=%s crashed, starts again", scheduler.name)
            await asyncio.sleep(RESTART_PAUSE_S)

    async def _keep_figures(self) -> None:
        while True:
            self._note_figures()
            await asyncio.sleep(FIGURES_EVERY_S)

    def _note_figures(self) -> None:
        for scheduler in self._schedulers:
            self._figures[scheduler.name] = {
                "crashes": self._crashes[scheduler.name],
                **scheduler.figures(),
            }


class _HostedLineClient(LocalLineClient):
    """A LineClient of a scheduler in the lines' thread."""

    def __init__(self, scheduler: Scheduler, host: LineHost) -> None:
        super().__init__(scheduler)
        self._host = host

    async def transact(self, unit: int, request: Request, *, response_time_s: float, lane: Lane) -> Outcome:
        """Send a request once; without a running line nothing is sent."""
        if not self._host.is_running():
            return Silent("port closed", is_sent=False)
        return await super().transact(unit, request, response_time_s=response_time_s, lane=lane)

    def figures(self) -> dict[str, Any]:
        """Return the line's counters and times, at most about a second old."""
        return self._host.figures(self.name)

    def _to_line(self, call: Callable[[], object]) -> None:
        self._host.to_line(call)

    def _to_app(self, call: Callable[[], object]) -> None:
        self._host.to_app(call)


class _Courier:
    """Carries calls from the lines' loop to the app's, in order, many at a time."""

    def __init__(self) -> None:
        self.loop: asyncio.AbstractEventLoop | None = None
        self._calls: deque[Callable[[], object]] = deque()
        self._is_posted = False
        self._timer: asyncio.TimerHandle | None = None

    def post(self, call: Callable[[], object]) -> None:
        """Have a call done now, after those that wait."""
        self._calls.append(call)
        self.flush()

    def post_soon(self, call: Callable[[], object]) -> None:
        """Have a call done within a moment: to wake the app's loop for each would cost more than the call."""
        self._calls.append(call)
        if self._timer is None:
            self._timer = asyncio.get_running_loop().call_later(SOON_S, self.flush)

    def flush(self) -> None:
        """Have done now what waits."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if self._calls and not self._is_posted and self.loop is not None:
            self._is_posted = True
            with contextlib.suppress(RuntimeError):  # the app's loop is closed: nobody is left to tell
                self.loop.call_soon_threadsafe(self._deliver)

    def _deliver(self) -> None:
        self._is_posted = False  # first, so that a call that comes from now on is posted anew
        try:
            while self._calls:
                self._calls.popleft()()
        finally:
            if self._calls and self.loop is not None:  # one of them raised; the rest must not wait for more
                self.loop.call_soon(self._deliver)


class _CarriedListener:
    """Hands every call on to the app's loop."""

    def __init__(self, listener: LineListener, courier: _Courier) -> None:
        self._listener = listener
        self._courier = courier

    def on_poll(self, line: str, key: str, unit: int, outcome: Outcome) -> None:
        self._courier.post_soon(lambda: self._listener.on_poll(line, key, unit, outcome))

    def on_unit(self, line: str, unit: int, is_answering: bool, reason: str, frames: tuple[str, ...]) -> None:  # noqa: FBT001 - as in LineListener
        self._courier.post(lambda: self._listener.on_unit(line, unit, is_answering, reason, frames))

    def on_trouble(self, line: str, code: str, unit: int, text: str, frames: tuple[str, ...]) -> None:
        self._courier.post(lambda: self._listener.on_trouble(line, code, unit, text, frames))

    def on_port(self, line: str, is_open: bool, reason: str) -> None:  # noqa: FBT001 - as in LineListener
        self._courier.post(lambda: self._listener.on_port(line, is_open, reason))
