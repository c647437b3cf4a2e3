"""A little of `python -m tests.torture`: with real processes and a real broker, and in this process."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.mosquitto import missing_programs
from tests.torture import clocks, fuzz, noise, soak
from tests.torture.scenario import Place
from tests.torture.scratch import scratch

LONGEST_S = 600.0  # on a machine with much other work
IN_PROCESS = (*noise.SCENARIOS, *clocks.SCENARIOS, *fuzz.SCENARIOS, *soak.SCENARIOS)
AT_ONCE = ((Place.CRASH, Place.BROKER, Place.LOG), (Place.HANG, Place.PORT))  # each takes half a minute


@pytest.mark.long
def test_what_is_promised_of_lines_and_input_holds_under_every_fault() -> None:
    command = [sys.executable, "-m", "tests.torture", "--short", *(each.name for each in IN_PROCESS)]

    done = subprocess.run(command, capture_output=True, text=True, timeout=LONGEST_S, check=False)

    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.alone
@pytest.mark.skipif(bool(missing_programs()), reason="needs mosquitto (apt-get install mosquitto)")
def test_what_is_promised_of_the_process_its_broker_and_its_port_holds_and_no_folder_is_left(
    tmp_path: Path,
) -> None:
    folder = tmp_path / "scratch"
    folder.mkdir()
    environ = {**os.environ, "TMPDIR": str(folder)}
    outputs = [tmp_path / f"{number}.txt" for number in range(len(AT_ONCE))]
    running = []
    for places, output in zip(AT_ONCE, outputs, strict=True):
        command = [sys.executable, "-m", "tests.torture", "--quick", *(place.value for place in places)]
        with output.open("wb") as file:
            running.append(subprocess.Popen(command, stdout=file, stderr=subprocess.STDOUT, env=environ))

    codes = [process.wait(LONGEST_S) for process in running]

    assert codes == [0] * len(AT_ONCE), "".join(output.read_text("utf-8") for output in outputs)
    assert list(folder.iterdir()) == []


def test_a_folder_of_a_run_that_fails_is_taken_away() -> None:
    with pytest.raises(RuntimeError), scratch("torture-test-") as folder:  # noqa: PT012
        (folder / "state").mkdir()
        (folder / "state" / "file").write_text("x", "utf-8")
        raise RuntimeError

    assert not folder.exists()
