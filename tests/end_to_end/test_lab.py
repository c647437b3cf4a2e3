"""The lab's programs work: a little of each, for they run in full by hand only."""

from __future__ import annotations

import asyncio
import os
import signal
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

from tests.lab.fleet.fleet import FleetPlan, fleet
from tests.lab.peers.bout import bout
from tests.lab.peers.contenders import Contender, Ours, Script
from tests.mosquitto import missing_programs

pytestmark = [
    pytest.mark.paired,
    pytest.mark.skipif(bool(missing_programs()), reason="needs mosquitto (apt-get install mosquitto)"),
]
PATIENCE_S = 240.0  # on a machine with much other work
PLAN = FleetPlan(gateways=2, starters=2, seconds=2.0)
PROGRAMS = [
    pytest.param(["torture", "--short", "errors 1 %", "malformed"], id="torture, in one process"),
    pytest.param(["torture", "--quick", "SIGKILL"], id="torture, a kill"),
    pytest.param(["bench", "--only", "judge"], id="bench"),
    pytest.param(["slow_box", "--share", "1", "--size", "1,1", "--seconds", "3"], id="slow box"),
]


@pytest.mark.parametrize("words", PROGRAMS)
def test_a_little_of_a_program_finds_nothing_wrong_and_leaves_no_folder(
    words: list[str], tmp_path: Path
) -> None:
    done = subprocess.run(
        [sys.executable, "-m", f"tests.lab.{words[0]}", *words[1:]],
        env={**os.environ, "TMPDIR": str(tmp_path)},
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )

    assert done.returncode == 0, done.stdout + done.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("contender", [Ours(), Script()], ids=lambda each: each.name)
async def test_nothing_wrong_is_seen_of_a_peer_that_has_no_faults(contender: Contender) -> None:
    async with bout(contender) as here:
        await asyncio.sleep(1.0)
        score = await here.score()

    assert (score.wrong, score.deaths, score.trips) == ([], 0, 0)


async def test_a_fleets_messages_reach_the_central_broker_whole_over_a_cut_a_kill_and_a_restart(
    tmp_path: Path,
) -> None:
    async with fleet(PLAN, tmp_path) as it:
        await it.start_up()
        await it.start_motors()
        await it.cut_and_restart()
        await it.end()

    found = it.result.verdict
    assert found is not None
    assert (found.lost, found.foreign, found.old_at_end, it.result.differing) == ([], [], [], [])
    assert it.result.starts == Counter({"confirmed: ok": PLAN.gateways * PLAN.starters})
    assert it.result.exits == [-signal.SIGKILL, 0, 0, 0]
