"""The motors' history outlives SIGKILL."""

from __future__ import annotations

import random
from pathlib import Path

from tests.end_to_end.killed_writer import write_until_killed
from tests.lab.torture.killed_history import kill_history_writer

KILLS = 8


def test_no_start_that_was_stored_is_lost_when_the_process_is_killed(tmp_path: Path) -> None:
    stored = kill_history_writer(write_until_killed, tmp_path, kills=KILLS, dice=random.Random(5))

    assert stored > 20 * KILLS
