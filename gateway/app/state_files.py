"""The small JSON files of the state directory, and what they retain of the clock from one run to the next."""

from __future__ import annotations

import asyncio
import logging
from pathlib import Path

from gateway.app.restart.gaps import RESTART_FILE
from gateway.errors import DamagedError
from gateway.records import PublishEvent, Severity
from gateway.starters.identity.registry import IDENTITIES_FILE
from gateway.starters.policy.motor_history import PRECAUTIONS_FILE
from gateway.starters.policy.write_budget import WEAR_FILE
from gateway.starters.telemetry.known_watchdogs import WATCHDOGS_FILE
from gateway.starters.telemetry.transitions import FAULTS_FILE
from gateway.storage.json_file import JsonFile, JsonStore, Saver
from gateway.system.clock import ClockWatch
from gateway.system.clock_steps import SETTLED_S

log = logging.getLogger(__name__)

CLOCK_FILE = "clock.json"  # in state_dir
SAVE_EVERY_S = 600.0
CLOSE_WITHIN_S = 1.0


class StateFiles:
    """The files of one gateway.

    Watchdogs, published faults and how long restarts take are stored always: they change without any command.
    The other files are written only while operators are configured.
    """

    def __init__(self, state_dir: Path, *, has_operators: bool) -> None:
        self.watchdogs = JsonFile(state_dir / WATCHDOGS_FILE)
        self.published_faults = JsonFile(state_dir / FAULTS_FILE)
        self.restart = JsonFile(state_dir / RESTART_FILE)
        names = (PRECAUTIONS_FILE, IDENTITIES_FILE, WEAR_FILE, CLOCK_FILE)
        self._switched = [JsonFile(state_dir / name, is_on=has_operators) for name in names]
        self.motor_history, self.identities, self.write_budget, self.clock = self._switched

    def switch(self, *, has_operators: bool) -> None:
        """Write the files that depend on operators from now on, or no longer."""
        for store in self._switched:
            store.is_on = has_operators


class ClockMemory:
    """Saves at the start, at every step and its end, every ten minutes and in an orderly end."""

    def __init__(self, watch: ClockWatch, store: JsonStore, *, publish_event: PublishEvent) -> None:
        self._watch = watch
        self._publish_event = publish_event
        self._saver = Saver(store, watch.document, on_trouble=self._note_trouble)
        try:
            watch.recall(store.load())
        except DamagedError as error:
            log.warning("%s; steps of the clock since the last run are not seen", error)
            store.set_aside()
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
            self._publish_event(
                "clock_trusted",
                Severity.INFO,
                "the clock is synchronised (or trusted) and steady: issued_at counts again",
            )
        else:
            again = f"until the clock was synchronised (or trusted) and steady for {SETTLED_S:g} s"
            text = f"{doubt}: issued_at does not count {again}"
            self._publish_event("clock_stepped", Severity.WARNING, text)
        self._saver.touch()

    def _note_trouble(self, trouble: str) -> None:
        if trouble:
            log.warning("the state of the clock cannot be stored: %s", trouble)
