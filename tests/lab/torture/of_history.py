"""SIGKILL while starts are recorded: of a process that does nothing else, and of the whole gateway.

No start that was stored is lost, and the file is never set aside. Also by itself:
`python -m tests.lab.torture history`.
"""

from __future__ import annotations

import random
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from tests.end_to_end.killed_writer import write_until_killed
from tests.lab.torture.killed_history import kill_history_writer
from tests.lab.torture.of_commands import Proof
from tests.lab.torture.of_history_kills import HistoryListener, history_kills
from tests.lab.torture.scenario import Row


@dataclass(frozen=True)
class HistoryScenario:
    """Kills of a process that does nothing but record starts."""

    name: str = "history: kills of writer"
    whole: int = 100
    short: int = 10

    def row(self, count: int, seed: int) -> Row:
        """Kill so many times and judge."""
        row = Row(self.name, f"{count} times")
        began_s = time.monotonic()
        with tempfile.TemporaryDirectory() as folder:
            try:
                stored = kill_history_writer(
                    write_until_killed, Path(folder), kills=count, dice=random.Random(seed)
                )
                row.measurements = {"starts": stored}
            except AssertionError as error:
                row.failures.append(str(error))
        row.took_s = time.monotonic() - began_s
        return row


GATEWAY = Proof("history: kills of gateway", history_kills, 100, 2, "times", make_listener=HistoryListener)
SCENARIOS: tuple[HistoryScenario | Proof, ...] = (HistoryScenario(), GATEWAY)
