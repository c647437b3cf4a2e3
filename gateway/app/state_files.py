"""The small JSON files of the state directory."""

from __future__ import annotations

from pathlib import Path

from gateway.starters.identity.registry import IDENTITIES_FILE
from gateway.starters.policy.motor_history import PRECAUTIONS_FILE
from gateway.starters.policy.write_budget import WEAR_FILE
from gateway.starters.telemetry.known_watchdogs import WATCHDOGS_FILE
from gateway.starters.telemetry.transitions import FAULTS_FILE
from gateway.storage.json_file import JsonFile


class StateFiles:
    """The files of one gateway.

    Watchdogs and published faults are stored always: they change without any command.
    The other files are written only while operators are configured.
    """

    def __init__(self, state_dir: Path, *, has_operators: bool) -> None:
        self.watchdogs = JsonFile(state_dir / WATCHDOGS_FILE)
        self.published_faults = JsonFile(state_dir / FAULTS_FILE)
        names = (PRECAUTIONS_FILE, IDENTITIES_FILE, WEAR_FILE)
        self._switched = [JsonFile(state_dir / name, is_on=has_operators) for name in names]
        self.motor_history, self.identities, self.write_budget = self._switched

    def switch(self, *, has_operators: bool) -> None:
        """Write the files that depend on operators from now on, or no longer."""
        for store in self._switched:
            store.is_on = has_operators
