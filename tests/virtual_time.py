"""An event loop whose time jumps to the next timer as soon as nothing else is left to do."""

from __future__ import annotations

import asyncio
import functools
import selectors
from collections.abc import Callable, Coroutine
from typing import Any, TypeVar

from gateway.system.clock import ClockReading

T = TypeVar("T")

EPOCH_S = 1_760_000_000.0  # the wall time at virtual second 0


class _JumpingSelector(selectors.DefaultSelector):
    """Reports ready files at once; where none is ready, the loop's time takes the wait.

    The system is asked only where there may be an answer: of a thread that has called, or, where nothing else
    is left to do, of a file.
    """

    def __init__(self) -> None:
        super().__init__()
        self.skipped_s = 0.0
        self.files = 0  # the first is the loop's own, through which threads and signals wake it
        self.may_be_woken = False

    def register(self, fileobj: Any, events: int, data: Any = None) -> selectors.SelectorKey:
        self.files += 1
        return super().register(fileobj, events, data)

    def unregister(self, fileobj: Any) -> selectors.SelectorKey:
        self.files -= 1
        return super().unregister(fileobj)

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        if self.may_be_woken or (self.files > 1 and timeout != 0):
            ready = super().select(0)
            if ready:
                return ready
        if timeout is None:
            raise RuntimeError("virtual time: nothing is scheduled, the test would never end")
        if timeout > 0:
            self.skipped_s += timeout
        return []


class VirtualTimeLoop(asyncio.SelectorEventLoop):
    """asyncio, but a day takes no longer than its events."""

    def __init__(self) -> None:
        self._jumping = _JumpingSelector()
        super().__init__(self._jumping)
        self._clock_resolution = 1e-9

    def time(self) -> float:
        return self._jumping.skipped_s

    def call_soon_threadsafe(self, *args: Any, **kwargs: Any) -> asyncio.Handle:
        self._jumping.may_be_woken = True  # from now on: who calls once may call again
        return super().call_soon_threadsafe(*args, **kwargs)

    def add_signal_handler(self, *args: Any) -> None:
        self._jumping.may_be_woken = True
        super().add_signal_handler(*args)

    def work(self, seconds: float) -> None:
        """Let the processor be busy for so long, and nothing else happen."""
        self._jumping.skipped_s += seconds


class HandClock:
    """A gateway.system.clock.Clock that a test sets."""

    def __init__(self, s: float = 0.0, *, epoch_s: float = EPOCH_S) -> None:
        self.s, self._epoch_s = s, epoch_s

    def now_s(self) -> float:
        return self.s

    def utc_s(self, at_s: float | None = None) -> float:
        return self._epoch_s + (self.now_s() if at_s is None else at_s)

    def reading(self) -> ClockReading:
        return ClockReading(self.now_s(), self.utc_s(), "boot-1")


class VirtualClock(HandClock):
    """A clock that follows a loop's virtual time."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        super().__init__()
        self._loop = loop

    def now_s(self) -> float:
        return self._loop.time()


def run_virtually(main: Coroutine[Any, Any, T]) -> T:
    """Run a coroutine to its end in virtual time and return what it returns."""
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        return runner.run(main)


def virtually(test: Callable[..., Coroutine[Any, Any, None]]) -> Callable[..., None]:
    """Let an async test run to its end in virtual time."""

    @functools.wraps(test)
    def run(*args: Any, **kwargs: Any) -> None:
        run_virtually(test(*args, **kwargs))

    return run
