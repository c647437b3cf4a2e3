"""Background work under supervision: begun anew, cancelled, closed; a bug is logged and ends only it."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Coroutine
from typing import Any

logger = logging.getLogger(__name__)

Work = Callable[[], Coroutine[Any, Any, None]]


class SupervisedTask:
    """At most one task at a time; all calls on the loop it runs on."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._task: asyncio.Task[None] | None = None

    def begin(self, work: Work) -> None:
        """Do this instead of what is under way."""
        self.cancel()
        self._task = asyncio.get_running_loop().create_task(self._run(work), name=self._name)

    def cancel(self) -> None:
        """Do nothing more."""
        if self._task is not None:
            self._task.cancel()
            self._task = None

    async def close(self) -> None:
        """Do nothing more, and wait until nothing of it is left."""
        task = self._task
        self.cancel()
        if task is not None:
            await asyncio.wait((task,))

    async def _run(self, work: Work) -> None:
        try:
            await work()
        except Exception:  # the guard at the task's top
            logger.exception("task=%s ended by a bug", self._name)
