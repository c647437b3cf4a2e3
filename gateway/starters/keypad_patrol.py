"""Re-reads a starter's settings in the background, a small block at a time, for the keypad watch."""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from math import inf
from typing import Any

from gateway.errors import CommandError, PortLostError
from gateway.families.bulk import bulk_reads
from gateway.families.procedure import Read
from gateway.families.watchdog import watchdog_codes
from gateway.line.job import Lane
from gateway.line.outcome import Outcome
from gateway.modbus.pdu import Request
from gateway.starters.bulk_reading import read_in_bulk
from gateway.starters.control import StarterControlView
from gateway.starters.identification import Standing
from gateway.starters.keypad_watch import KeypadWatch, watched_codes

logger = logging.getLogger(__name__)

VERBS = ("set", "configure")
EVERY_S = 60.0  # one block; an SSW900's settings are some 20 blocks
FIRST_LAP_EVERY_S = 10.0  # until all of them are known: what is changed before cannot be noticed
REFUSALS = 3  # of a row, in as many laps, before it is left out for the rest of the hour
HOUR_S = 3600.0
LONGEST_BLOCK = (
    24  # registers: no request of an identification is shorter on the line, so no stop waits longer
)


class KeypadPatrol:
    """Walks round the settings of one starter for ever, while it answers and is who it should be."""

    def __init__(
        self,
        starter: StarterControlView,
        *,
        on_change: Callable[[], None] = lambda: None,
        every_s: float = EVERY_S,
    ) -> None:
        self._starter = starter
        self._on_change = on_change
        self._every_s = every_s
        self._watch = KeypadWatch(starter.profile)
        self._limit = min(LONGEST_BLOCK, starter.profile.limits.read_registers // 2)
        self._reads = self._lap()
        self._left_of_first_lap = len(self._reads)  # blocks: the first lap makes known what there is
        self._refusals: dict[str, int] = {}  # by row, since the hour began
        self._hour_began_s = -inf
        self._task: asyncio.Task[None] | None = None

    def start(self) -> None:
        """Begin to walk; once."""
        if self._reads:
            name = f"keypad {self._starter.setup.name}"
            self._task = asyncio.get_running_loop().create_task(self._run(), name=name)

    async def close(self) -> None:
        """Walk no more, and wait until nothing of it is left."""
        if self._task is not None:
            self._task.cancel()
            await asyncio.wait((self._task,))

    def note_command(self, verb: str, args: Mapping[str, Any], *, is_over: bool) -> None:
        """Take over that a command of ours begins or has ended."""
        if verb in VERBS:
            self._watch.note_command(self._starter.variant, verb, args, is_over=is_over)

    def note_reading(self, rows: Mapping[str, tuple[int, ...]]) -> None:
        """Take over settings that were just read on another occasion, and tell what has changed."""
        self._tell_changes(rows)

    def recall(self, rows: Mapping[str, tuple[int, ...]]) -> None:
        """Take over settings as they were in an earlier run: what reads otherwise now was changed since."""
        self._watch.recall(rows)

    def note_written(self, rows: Mapping[str, tuple[int, ...]]) -> None:
        """Take over that the gateway itself writes these rows now."""
        self._watch.note_written(rows)

    async def _run(self) -> None:
        while self._reads:
            await asyncio.sleep(self._pause_s())
            starter = self._starter
            if not starter.is_answering or starter.identity_standing is not Standing.MATCHING:
                continue
            self._ask_again_each_hour()
            read = self._reads.popleft()
            self._left_of_first_lap -= 1
            try:
                self._reads += await self._look(read)
            except (CommandError, PortLostError):  # the polls tell that it is silent
                self._reads.append(read)
            except Exception:  # the guard at the task's top
                logger.exception("starter=%s keypad patrol met a bug", starter.setup.name)
                return

    async def _look(self, read: Read) -> tuple[Read, ...]:
        """Read one block and tell what has changed; return what to read next time."""
        starter = self._starter
        found = await read_in_bulk(self._ask, starter.profile, [read], tries=1)
        starter.note_settings(found.rows)
        if self._tell_changes(found.rows):
            self._on_change()
        if not found.refused:
            return (read,)
        again = [code for code in found.refused if self._is_asked_again(code)]
        return (*self._planned(found.rows), *(each for code in again for each in self._planned([code])))

    def _tell_changes(self, rows: Mapping[str, tuple[int, ...]]) -> bool:
        """Publish which of these rows were changed at the starter; return whether any was."""
        starter = self._starter
        changes = self._watch.note_reading(starter.variant, rows)
        for change in changes:
            starter.publisher.change(change)
        return bool(changes)

    def _pause_s(self) -> float:
        return min(FIRST_LAP_EVERY_S, self._every_s) if self._left_of_first_lap > 0 else self._every_s

    def _is_asked_again(self, code: str) -> bool:
        """Return whether a row that was refused, each time a lap apart, is asked for in the next lap."""
        count = self._refusals[code] = self._refusals.get(code, 0) + 1
        return count < REFUSALS or code in watchdog_codes(self._starter.profile)

    def _ask_again_each_hour(self) -> None:
        """Ask for everything again that was refused in the hour before."""
        now_s = asyncio.get_running_loop().time()
        if now_s - self._hour_began_s < HOUR_S:
            return
        self._hour_began_s = now_s
        if self._refusals:
            self._refusals.clear()
            self._reads = self._lap()

    def _lap(self) -> deque[Read]:
        return deque(self._planned(watched_codes(self._starter.profile)))

    def _planned(self, codes: Iterable[str]) -> tuple[Read, ...]:
        return bulk_reads(self._starter.profile, codes, longest=self._limit)

    async def _ask(self, request: Request) -> Outcome:
        setup = self._starter.setup
        response_time_s = setup.response_time_of(request)
        return await self._starter.line.transact(
            setup.address, request, response_time_s=response_time_s, lane=Lane.PARAMETERS
        )
