"""The world of a scenario: virtual time, seeded chance, and threads that take their time from the loop.

Whatever reads `time`, asks `secrets` for chance, or starts a thread gets the scenario's own, so that the same
scenario gives the same bytes. Time passes only while the loop has nothing to do.
"""

from __future__ import annotations

import asyncio
import contextlib
import gc
import os
import queue
import random
import secrets
import signal
import threading
import time
import uuid
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any
from unittest.mock import patch

from tests.virtual_time import VirtualTimeLoop

START_S = 1000.0  # of the steady clock
EPOCH_S = 1_795_219_200.0  # the wall time then: 2026-11-21T00:00:00Z


class RigLoop(VirtualTimeLoop):
    """A virtual loop without a signal, a thread or a socket of its own."""

    def __init__(self) -> None:
        super().__init__()
        self._jumping.skipped_s = START_S
        self.handlers: dict[int, Callable[[], object]] = {}  # by signal

    def add_signal_handler(self, number: int, call: Callable[..., object], *args: Any) -> None:
        self.handlers[number] = lambda: call(*args)

    def remove_signal_handler(self, number: int) -> bool:
        return self.handlers.pop(number, None) is not None

    def call_soon_threadsafe(self, call: Callable[..., object], *args: Any, **kwargs: Any) -> asyncio.Handle:
        return self.call_soon(call, *args, **kwargs)  # a thread runs only while the loop waits for it

    def run_in_executor(self, _executor: Any, call: Callable[..., Any], *args: Any) -> Any:
        done = self.create_future()
        try:
            done.set_result(call(*args))
        except Exception as error:  # noqa: BLE001 - whatever it raises is its caller's
            done.set_exception(error)
        return done

    # Wires (tests.rig.broker) in place of sockets

    def add_reader(self, fd: Any, call: Callable[..., object], *args: Any) -> None:
        _wire_or(super().add_reader, fd, "reader", call, *args)

    def remove_reader(self, fd: Any) -> bool:
        return _unwire_or(super().remove_reader, fd, "reader")

    def add_writer(self, fd: Any, call: Callable[..., object], *args: Any) -> None:
        _wire_or(super().add_writer, fd, "writer", call, *args)

    def remove_writer(self, fd: Any) -> bool:
        return _unwire_or(super().remove_writer, fd, "writer")


def _wire_or(otherwise: Callable[..., Any], fd: Any, end: str, call: Callable[..., Any], *args: Any) -> None:
    if hasattr(fd, "watch"):
        fd.watch(end, (lambda: call(*args)) if args else call)
    else:
        otherwise(fd, call, *args)


def _unwire_or(otherwise: Callable[[Any], bool], fd: Any, end: str) -> bool:
    if hasattr(fd, "watch"):
        fd.watch(end, None)
        return True
    return otherwise(fd)


class _Baton:
    """One thread runs at a time: the loop's, or one that it lets run until that waits for something."""

    def __init__(self, loop: RigLoop) -> None:
        self.loop = loop
        self.back = threading.Semaphore(0)
        self.main = threading.get_ident()
        self.threads: list[RigThread] = []
        self.is_over = False

    def give(self, thread: RigThread) -> None:
        """Let a thread run until it waits again or ends."""
        if threading.get_ident() != self.main:
            self.loop.call_soon(self.give, thread)
        elif thread.is_waiting:
            thread.is_waiting = False
            thread.go.release()
            self.back.acquire()

    def wait(self, waiters: list[RigThread], timeout: float | None) -> None:
        """Let the loop go on until somebody wakes this thread, or until the virtual time is over."""
        thread = threading.current_thread()
        if not isinstance(thread, RigThread):
            raise RuntimeError("the loop's own thread cannot wait")  # noqa: TRY004
        waiters.append(thread)
        timer = None if timeout is None else self.loop.call_later(timeout, self.give, thread)
        thread.is_waiting = True
        self.back.release()
        thread.go.acquire()
        if timer is not None:
            timer.cancel()
        if thread in waiters:
            waiters.remove(thread)

    def end(self) -> None:
        """End every thread that still waits: its queue gives it None, as its owner would."""
        self.is_over = True
        for thread in self.threads:
            if thread.is_waiting:
                self.give(thread)
        self.threads.clear()
        self.is_over = False


class RigThread(threading.Thread):
    """A thread that runs when the loop lets it."""

    baton: _Baton
    is_waiting = False

    def start(self) -> None:
        self.go = threading.Semaphore(0)
        self.baton.threads.append(self)
        super().start()
        self.baton.back.acquire()

    def run(self) -> None:
        try:
            super().run()
        finally:
            self.baton.back.release()

    def join(self, timeout: float | None = None) -> None:
        if not self.is_waiting:  # else it waits for a time that does not pass meanwhile
            super().join(timeout)


class RigEvent(threading.Event):
    """An event for which a thread waits in virtual time."""

    baton: _Baton

    def __init__(self) -> None:
        super().__init__()
        self._waiters: list[RigThread] = []

    def wait(self, timeout: float | None = None) -> bool:
        if not isinstance(threading.current_thread(), RigThread):
            return super().wait(timeout)
        if not self.is_set() and not self.baton.is_over:
            self.baton.wait(self._waiters, timeout)
        return self.is_set() or self.baton.is_over

    def set(self) -> None:
        super().set()
        for thread in tuple(self._waiters):
            self.baton.give(thread)


class RigQueue:
    """`queue.SimpleQueue`; what is put in is taken out at once by the thread that waits for it."""

    baton: _Baton

    def __init__(self) -> None:
        self._items: deque[Any] = deque()
        self._waiters: list[RigThread] = []

    def put(self, item: Any, block: bool = True, timeout: float | None = None) -> None:
        self._items.append(item)
        if self._waiters:
            self.baton.give(self._waiters[0])

    def get(self, block: bool = True, timeout: float | None = None) -> Any:
        until_s = None if timeout is None else self.baton.loop.time() + timeout
        while not self._items:
            if self.baton.is_over:
                return None
            if not block or (until_s is not None and self.baton.loop.time() >= until_s):
                raise queue.Empty
            self.baton.wait(self._waiters, None if until_s is None else until_s - self.baton.loop.time())
        return self._items.popleft()


class RigWorld:
    """Time and chance as a scenario sees them."""

    def __init__(self, seed: int = 0) -> None:
        self.loop = RigLoop()
        self.stepped_s = 0.0  # the wall clock
        self.slept_s = 0.0  # the machine, which its steady clock does not show
        self._dice = random.Random(seed)
        self._baton: _Baton | None = None

    def abandon(self) -> None:
        """Let the process be gone: no task and no thread goes on."""
        while tasks := asyncio.all_tasks(self.loop):  # one that is cancelled may begin another
            for task in tasks:
                task.cancel()
            self.loop.run_until_complete(asyncio.wait(tasks))
        if self._baton is not None:
            self._baton.end()

    def now_s(self) -> float:
        """Return the seconds since the scenario's beginning."""
        return self.loop.time() - START_S

    def utc_s(self) -> float:
        return EPOCH_S + self.now_s() + self.stepped_s + self.slept_s

    def token_bytes(self, size: int | None = None) -> bytes:
        return self._dice.randbytes(32 if size is None else size)

    def _clock(self, number: int) -> float:
        if number == time.CLOCK_REALTIME:
            return self.utc_s()
        if number == time.CLOCK_BOOTTIME:
            return self.loop.time() + self.slept_s
        return self.loop.time()

    @contextmanager
    def entered(self) -> Iterator[None]:
        """Be what the process sees."""
        baton = self._baton = _Baton(self.loop)
        with ExitStack() as stack:
            for owner, name, value in (
                (time, "time", self.utc_s),
                (time, "time_ns", lambda: int(self.utc_s() * 1e9)),
                (time, "monotonic", self.loop.time),
                (time, "clock_gettime", self._clock),
                (secrets, "token_bytes", self.token_bytes),
                (secrets, "randbits", self._dice.getrandbits),
                (os, "urandom", self.token_bytes),
                (uuid, "uuid4", lambda: uuid.UUID(bytes=self.token_bytes(16), version=4)),
                (threading, "Thread", type("Thread", (RigThread,), {"baton": baton})),
                (threading, "Event", type("Event", (RigEvent,), {"baton": baton})),
                (queue, "SimpleQueue", type("SimpleQueue", (RigQueue,), {"baton": baton})),
                (asyncio, "run", self.run),
                (asyncio, "Runner", lambda **_: contextlib.nullcontext(self)),
                (gc, "collect", lambda *_: 0),  # what a service does with its heap costs a test 30 ms
                (gc, "freeze", lambda: None),
                (gc, "unfreeze", lambda: None),
                (gc, "set_threshold", lambda *_: None),
            ):
                stack.enter_context(patch.object(owner, name, value))
            yield

    def run(self, work: Any, **_: Any) -> Any:
        """Run a coroutine to its end beside everything else; in place of `asyncio.run`."""
        return self.loop.run_until_complete(work)

    def signal(self, number: signal.Signals) -> None:
        """Have the process's handler of a signal called."""
        self.loop.call_soon(self.loop.handlers[number])
