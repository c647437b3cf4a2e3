"""The short form of `python -m tests.torture` that needs no real time: lines, noise and input, in process.

The forms with real processes measure seconds and want the machine for themselves: `make torture`, or
`python -m tests.torture --short`.
"""

from __future__ import annotations

import subprocess
import sys

import pytest

from tests.torture import fuzz, noise, soak

LONGEST_S = 300.0
IN_PROCESS = tuple(each.name for each in (*noise.SCENARIOS, *fuzz.SCENARIOS, *soak.SCENARIOS))


@pytest.mark.end_to_end
def test_what_is_promised_of_lines_and_input_holds_under_every_fault() -> None:
    command = [sys.executable, "-m", "tests.torture", "--short", *IN_PROCESS]

    done = subprocess.run(command, capture_output=True, text=True, timeout=LONGEST_S, check=False)

    assert done.returncode == 0, done.stdout + done.stderr
