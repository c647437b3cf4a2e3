"""The short form of `python -m tests.torture`: a little of every fault."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator

import pytest

from tests.mosquitto import missing_programs
from tests.torture import fuzz, noise, soak
from tests.torture.of_disk import may_mount

LONGEST_S = 300.0
IN_PROCESS = tuple(each.name for each in (*noise.SCENARIOS, *fuzz.SCENARIOS, *soak.SCENARIOS))
LANES = {  # run at the same time, each in a process of its own: most of their time is waiting
    "broker": ("broker",),
    "port and disk": ("port", "disk") if may_mount() else ("port",),
    "process": ("crash", "hang", "log"),
    "lines and input": IN_PROCESS,
}


@pytest.fixture(scope="module")
def lanes() -> Iterator[dict[str, subprocess.Popen[str]]]:
    if missing := missing_programs():
        pytest.skip(f"not installed: {', '.join(missing)}")
    running = {}
    for name, scenarios in LANES.items():
        nice = ("nice",) if scenarios is IN_PROCESS else ()  # it computes, the others have deadlines
        command = [*nice, sys.executable, "-m", "tests.torture", "--short", *scenarios]
        running[name] = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    yield running
    for process in running.values():
        process.kill()
        process.communicate()


@pytest.mark.end_to_end
@pytest.mark.mosquitto
@pytest.mark.parametrize("lane", list(LANES))
def test_what_is_promised_holds_under_every_fault(lanes: dict[str, subprocess.Popen[str]], lane: str) -> None:
    report, _ = lanes[lane].communicate(timeout=LONGEST_S)

    assert lanes[lane].returncode == 0, report
