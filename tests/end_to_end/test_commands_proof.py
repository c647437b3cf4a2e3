"""What is promised of commands, tried with real processes in short; whole: `python -m tests.lab.torture`."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.lab.torture.of_commands import (
    KILLS,
    STALE,
    STALLED,
    STOPS,
    Proof,
)
from tests.mosquitto import StartMosquitto

SEED = 1


@pytest.fixture(autouse=True)
def _needs_mosquitto(start_mosquitto: StartMosquitto) -> StartMosquitto:
    """Skip where the broker is not installed; each proof has a broker of its own."""
    return start_mosquitto


async def try_shortly(proof: Proof, folder: Path) -> None:
    row = await proof.on_site(folder, proof.short, SEED)

    assert row.failures == [], str(row)


@pytest.mark.paired
@pytest.mark.long
async def test_a_kill_around_a_start_never_makes_a_second_start_frame_nor_a_dishonest_result(
    tmp_path: Path,
) -> None:
    await try_shortly(KILLS, tmp_path)


@pytest.mark.alone
async def test_a_stop_just_after_start_up_goes_out_and_is_confirmed_at_once(tmp_path: Path) -> None:
    await try_shortly(STOPS, tmp_path)


@pytest.mark.long
async def test_retained_expired_replayed_and_queued_commands_start_nothing(
    tmp_path: Path,
) -> None:
    await try_shortly(STALE, tmp_path)


@pytest.mark.alone
async def test_a_start_that_a_standing_broker_held_for_too_long_makes_no_start_frame(
    tmp_path: Path,
) -> None:
    await try_shortly(STALLED, tmp_path)
