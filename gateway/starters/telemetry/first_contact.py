"""Reads the watchdog of a starter as soon as it answers, before anything else is asked of it at leisure.

A watchdog counts from the first telegram that reaches the starter (ssw900 C8.2.5; ssw06-es and ssw07 2.4), so
it must be known before the line has come round once; what else can be asked of the starter follows later.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Mapping

from gateway.errors import CommandError, PortLostError
from gateway.families.diagnosis.readiness import time_codes
from gateway.families.reading.bulk import bulk_reads
from gateway.line.client import LineClient
from gateway.line.rtu.outcome import Outcome
from gateway.line.scheduler.requests import Priority
from gateway.modbus.pdu import Request
from gateway.starters.bulk_read import read_in_bulk
from gateway.starters.setup import StarterSetup

logger = logging.getLogger(__name__)


class FirstContact:
    """One starter's; `on_rows` is given what was read, on the app's loop."""

    def __init__(
        self,
        setup: StarterSetup,
        line: LineClient,
        on_rows: Callable[[Mapping[str, tuple[int, ...]]], None],
    ) -> None:
        self._setup = setup
        self._line = line
        self._on_rows = on_rows
        self._reads = bulk_reads(setup.profile, time_codes(setup.profile))
        self._lane = Priority.COMMAND
        self._task: asyncio.Task[None] | None = None

    def begin(self, *, is_known: bool) -> None:
        """Read, in a task of its own; what is known already waits until all starters have been asked once."""
        self.cancel()
        self._lane = Priority.READ_BACK if is_known else Priority.COMMAND
        name = f"first contact {self._setup.name}"
        self._task = asyncio.get_running_loop().create_task(self._run(), name=name)

    def cancel(self) -> None:
        """Read no more."""
        if self._task is not None:
            self._task.cancel()
            self._task = None

    async def close(self) -> None:
        """Read no more, and wait until nothing of it is left."""
        task = self._task
        self.cancel()
        if task is not None:
            await asyncio.wait((task,))

    async def _run(self) -> None:
        try:
            found = await read_in_bulk(self._ask, self._setup.profile, self._reads, tries=1)
        except (CommandError, PortLostError):
            return  # it is read again with the other settings
        except Exception:  # the guard at the task's top
            logger.exception("starter=%s first contact ended by a bug", self._setup.name)
            return
        self._on_rows(found.rows)

    async def _ask(self, request: Request) -> Outcome:
        return await self._line.transact(
            self._setup.address,
            request,
            response_time_s=self._setup.response_time_of(request),
            lane=self._lane,
        )
