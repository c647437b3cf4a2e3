"""Background work under supervision: a bug is logged and ends only the work that has it.

`SupervisedTask` is restarted, cancelled and closed by its owner; `keep_running` starts a failed loop again;
`until_first` ends all when one of several ends; `is_set_within` waits for an event or a time;
`on_this_loop` brings back what a thread says.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable, Coroutine
from contextlib import suppress
from functools import partial
from math import inf
from typing import Any, ParamSpec, Protocol, TypeVar

logger = logging.getLogger(__name__)

Work = Callable[[], Coroutine[Any, Any, None]]
P = ParamSpec("P")
T = TypeVar("T")


RESTART_PAUSE_S = 1.0


class InThread(Protocol):
    """Does work in a thread: `asyncio.to_thread`, but for tests."""

    def __call__(self, work: Callable[[], T], /) -> Awaitable[T]:
        """Return what it gives."""


def on_this_loop(call: Callable[P, object]) -> Callable[P, None]:
    """Return what any thread may call to have `call` done on this loop; nothing once that is closed."""
    loop = asyncio.get_running_loop()

    def post(*args: P.args, **kwargs: P.kwargs) -> None:
        with suppress(RuntimeError):  # the loop is closed
            loop.call_soon_threadsafe(partial(call, *args, **kwargs))

    return post


async def keep_running(name: str, work: Callable[[], Awaitable[None]]) -> None:
    """Run a loop until it ends by itself; after a bug it is started again, as often as it takes."""
    while True:
        try:
            await work()
        except Exception:
            logger.exception("task=%s failed and is started again, as often as it takes", name)
        else:
            return
        await asyncio.sleep(RESTART_PAUSE_S)


async def until_first(*works: Awaitable[object]) -> None:
    """Do these at once until one of them ends, and cancel the others; raises what an ended one raised."""
    tasks = [asyncio.ensure_future(work) for work in works]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in tasks:
            if task.done():
                task.result()
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


async def is_set_within(event: asyncio.Event, within_s: float) -> bool:
    """Wait until an event is set, but not longer than this, which may be infinite; return whether it is."""
    with suppress(TimeoutError):
        async with asyncio.timeout(None if within_s == inf else within_s):
            await event.wait()
    return event.is_set()


class SupervisedTask:
    """At most one task at a time; all calls on the loop it runs on."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._task: asyncio.Task[None] | None = None

    def begin(self, work: Work) -> None:
        """Start this work; work that is under way is cancelled."""
        self.cancel()
        self._task = asyncio.get_running_loop().create_task(self._run(work), name=self._name)

    def cancel(self) -> None:
        """Cancel the work."""
        if self._task is not None:
            self._task.cancel()

    async def close(self) -> None:
        """Cancel the work and wait for its end."""
        self.cancel()
        if self._task is not None:
            await asyncio.wait((self._task,))

    async def _run(self, work: Work) -> None:
        try:
            await work()
        except Exception:  # the guard at the task's top
            logger.exception("task=%s ended by a bug", self._name)
        finally:
            if self._task is asyncio.current_task():
                self._task = None  # with all that it holds; its owner may live for years
