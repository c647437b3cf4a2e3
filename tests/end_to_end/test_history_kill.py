"""The motors' history outlives SIGKILL."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from tests.end_to_end.killed_writer import write_until_killed
from tests.lab.torture.killed_history import kill_history_writer
from tests.lab.torture.of_history import GATEWAY
from tests.mosquitto import StartMosquitto

KILLS = 8


def test_no_start_that_was_stored_is_lost_when_the_process_is_killed(tmp_path: Path) -> None:
    stored = kill_history_writer(write_until_killed, tmp_path, kills=KILLS, dice=random.Random(5))

    assert stored > 20 * KILLS


@pytest.mark.long
async def test_a_kill_of_the_gateway_loses_no_start_and_publishes_each_that_is_stored(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    assert start_mosquitto, "the site has a broker of its own"

    row = await GATEWAY.on_site(tmp_path, GATEWAY.short, seed=1)

    assert row.failures == [], str(row)
