"""The lab's programs work: a little of each, for they run in full by hand only."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.mosquitto import missing_programs

pytestmark = [
    pytest.mark.paired,
    pytest.mark.skipif(bool(missing_programs()), reason="needs mosquitto (apt-get install mosquitto)"),
]
PATIENCE_S = 240.0  # on a machine with much other work
PROGRAMS = [
    pytest.param(["torture", "--short", "errors 1 %", "malformed"], id="torture, in one process"),
    pytest.param(["torture", "--short", "--count", "2", "SIGKILL"], marks=pytest.mark.long, id="kills"),
    pytest.param(["torture", "--short", "stop at", "stalled ways"], id="stops and stalls"),
    pytest.param(["torture", "--short", "stale"], marks=pytest.mark.long, id="queued commands"),
    pytest.param(["bench", "--only", "judge"], id="bench"),
    pytest.param(["fleet", "--gateways=1", "--starters=1", "--seconds=2", "--fill=2"], id="fleet"),
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
