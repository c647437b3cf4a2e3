"""What is promised of commands, tried with real processes in short; whole: `python -m tests.lab.torture`."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.lab.torture.of_commands import (
    FLOOD,
    KILLS,
    MALFORMED,
    MALFORMED_PURE,
    STALE,
    STALE_OLD,
    STALLED,
    STALLED_OLD,
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


@pytest.mark.alone
async def test_a_flood_of_commands_leaves_memory_polls_and_the_stop_within_their_bounds(
    tmp_path: Path,
) -> None:
    await try_shortly(FLOOD, tmp_path)


@pytest.mark.long
async def test_retained_expired_replayed_and_queued_commands_start_nothing_on_either_version_of_mqtt(
    tmp_path: Path,
) -> None:
    await try_shortly(STALE, tmp_path)


@pytest.mark.long
async def test_neither_do_they_on_a_gateway_whose_broker_knows_no_mqtt_5(tmp_path: Path) -> None:
    await try_shortly(STALE_OLD, tmp_path)


async def test_malformed_payloads_through_a_broker_are_refused_with_a_reason_and_disturb_no_line(
    tmp_path: Path,
) -> None:
    await try_shortly(MALFORMED, tmp_path)


def test_thousands_of_malformed_payloads_are_each_refused_with_a_reason_and_none_raises() -> None:
    row = MALFORMED_PURE.row(MALFORMED_PURE.short, SEED)

    assert row.failures == [], str(row)


@pytest.mark.alone
@pytest.mark.parametrize("proof", [STALLED, STALLED_OLD], ids=["mqtt 5", "mqtt 3.1.1"])
async def test_a_start_that_a_standing_broker_held_for_too_long_makes_no_start_frame(
    proof: Proof, tmp_path: Path
) -> None:
    await try_shortly(proof, tmp_path)
