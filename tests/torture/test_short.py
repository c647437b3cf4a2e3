"""The short form of `python -m tests.torture`: a little of every fault."""

from __future__ import annotations

import shutil
from typing import Any

import pytest

from tests.mosquitto import missing_programs
from tests.torture import fuzz, noise, soak
from tests.torture.of_disk import may_mount
from tests.torture.runner import SCENARIOS, run_place
from tests.torture.scenario import Place, Row

SEED = 1
IN_PROCESS = (*noise.SCENARIOS, *fuzz.SCENARIOS, *soak.SCENARIOS)


def failures(rows: list[Row]) -> list[str]:
    return [f"{row.name}: {failure}" for row in rows for failure in row.failures]


@pytest.mark.end_to_end
@pytest.mark.mosquitto
@pytest.mark.parametrize("place", list(Place), ids=lambda place: place.value)
async def test_what_is_promised_holds_under_faults_of_processes_broker_port_and_disk(place: Place) -> None:
    if missing := missing_programs():
        pytest.skip(f"not installed: {', '.join(missing)}")
    if place is Place.DISK and not (may_mount() and shutil.which("mount")):
        pytest.skip("only root can mount a small disk")
    chosen = [each for each in SCENARIOS if each.place is place]

    rows = await run_place(place, chosen, is_short=True, seed=SEED)

    assert failures(rows) == []


@pytest.mark.parametrize("scenario", IN_PROCESS, ids=lambda scenario: scenario.name)
def test_what_is_promised_holds_on_bad_lines_and_with_random_input(scenario: Any) -> None:
    row = scenario.row(scenario.short, SEED)

    assert failures([row]) == []
