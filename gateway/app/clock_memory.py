"""Keeps what the next run must know of the clock, and publishes when the clock was stepped."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable

from gateway.errors import DamagedError
from gateway.records import Severity
from gateway.storage.json_file import JsonStore, Saver
from gateway.system.clock import ClockWatch
from gateway.system.clock_steps import SETTLED_S

log = logging.getLogger(__name__)

CLOCK_FILE = "clock.json"  # in state_dir
SAVE_EVERY_S = 600.0
CLOSE_WITHIN_S = 1.0


class ClockMemory:
    """Saves at the start, at every step and its end, every ten minutes and in an orderly end."""

    def __init__(
        self, watch: ClockWatch, memory: JsonStore, *, tell: Callable[[str, Severity, str], None]
    ) -> None:
        self._watch = watch
        self._memory = memory
        self._tell = tell
        self._saver = Saver(memory, watch.document, on_trouble=self._note_trouble)
        try:
            watch.recall(memory.load())
        except DamagedError as error:
            log.warning("%s; steps of the clock since the last run are not seen", error)
            memory.set_aside()
        watch.on_change = self._note_change

    async def run(self) -> None:
        """Publish what is known from the start, and save now and then."""
        if self._watch.step is not None:
            self._note_change(self._watch.step)
        while True:
            self._saver.touch()
            await asyncio.sleep(SAVE_EVERY_S)

    async def close(self) -> None:
        """Save once more."""
        self._saver.touch()
        await self._saver.close(within_s=CLOSE_WITHIN_S)

    def _note_change(self, doubt: str | None) -> None:
        if doubt is None:
            self._tell(
                "clock_trusted", Severity.INFO, "the clock is synchronised and steady: issued_at counts again"
            )
        else:
            text = f"{doubt}: issued_at does not count until the clock was synchronised for {SETTLED_S:g} s"
            self._tell("clock_stepped", Severity.WARNING, text)
        self._saver.touch()

    def _note_trouble(self, trouble: str) -> None:
        if trouble:
            log.warning("what is known of the clock is not kept: %s", trouble)
