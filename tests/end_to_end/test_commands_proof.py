"""What is promised of commands, tried with real processes in short; whole: `python -m tests.lab.torture`."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.lab.torture.of_commands import KILLS, STALE, STALLED, STOPS, Proof
from tests.mosquitto import StartMosquitto

PROOFS = [
    pytest.param(KILLS, marks=(pytest.mark.paired, pytest.mark.long), id="a kill around a start"),
    pytest.param(STOPS, marks=pytest.mark.alone, id="a stop just after start-up"),
    pytest.param(STALE, marks=pytest.mark.long, id="commands that were queued or waited in a socket"),
    pytest.param(STALLED, marks=pytest.mark.alone, id="a start that a standing broker held"),
]


@pytest.mark.parametrize("proof", PROOFS)
async def test_no_command_acts_twice_late_or_with_a_dishonest_result(
    proof: Proof, start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    """Each has a broker of its own; the fixture skips where none is installed."""
    row = await proof.on_site(tmp_path, proof.short, seed=1)

    assert row.failures == [], str(row)
