"""What `doctor` finds in a machine."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from gateway.cli.doctor.findings import Finding, Findings
from gateway.cli.doctor.machine import (
    clock_finding,
    disk_finding,
    latency_finding,
    state_dir_finding,
    sync_s,
    timers_finding,
)
from gateway.cli.doctor.starters import telegrams_finding
from gateway.families.devices.findings import Weight
from tests.ordinary_user import give


def _latency(folder: Path, milliseconds: int) -> Finding | None:
    (folder / "ttyUSB0" / "device").mkdir(parents=True)
    (folder / "ttyUSB0" / "device" / "latency_timer").write_text(f"{milliseconds}\n", "ascii")
    return latency_finding("/dev/ttyUSB0", "line hall", sysfs=folder)


@pytest.mark.parametrize(
    ("found", "weight"),
    [
        (lambda folder: _latency(folder, 2), None),
        (lambda folder: _latency(folder, 16), Weight.WARNING),
        (lambda _: clock_finding(lambda: True), None),
        (lambda _: clock_finding(lambda: False), Weight.WARNING),
        (lambda _: clock_finding(lambda: None), Weight.NOTE),
        (lambda _: timers_finding(0.0001, 0.002), None),
        (lambda _: timers_finding(0.004, 0.004), Weight.WARNING),
        (lambda _: disk_finding(0.2), None),
        (lambda _: disk_finding(0.5), Weight.WARNING),
        (lambda _: disk_finding(1.5), Weight.ERROR),
        (lambda _: telegrams_finding("mill", 5000, 5000, 0, 0), None),
        (lambda _: telegrams_finding("mill", 5000, 4950, 50, 0), Weight.NOTE),
        (lambda _: telegrams_finding("mill", 5000, 4949, 51, 0), Weight.WARNING),
        (lambda _: telegrams_finding("mill", 3, 3, 0, 7), Weight.NOTE),
        (lambda _: telegrams_finding("mill", 3, 3, 10, 0), Weight.NOTE),  # as after 65,536 requests
        (state_dir_finding, None),
        (lambda folder: state_dir_finding(folder / "new" / "state"), None),  # `run` makes it
        (lambda folder: state_dir_finding(folder / "file"), Weight.ERROR),
        (lambda folder: state_dir_finding(folder / "file" / "none"), Weight.ERROR),
    ],
)
def test_how_much_a_finding_weighs(
    found: Callable[[Path], Finding | None], weight: Weight | None, tmp_path: Path
) -> None:
    (tmp_path / "file").touch()

    finding = found(tmp_path)

    assert finding is not None
    assert finding.weight is weight


def test_what_may_not_be_written_of_the_state_directory_is_a_problem(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("history.sqlite", "state.sqlite", "not-the-gateways"):
        (tmp_path / name).touch()
    denied, access = "not-the-gateways", os.access
    monkeypatch.setattr(os, "access", lambda path, how: Path(path).name != denied and access(path, how))
    assert state_dir_finding(tmp_path).weight is None

    denied = "history.sqlite"
    file = state_dir_finding(tmp_path)
    assert file.weight is Weight.ERROR
    assert f"{tmp_path}/history.sqlite in it may not be written by the gateway's user (chown -R" in file.said

    denied = tmp_path.name
    assert "may not be written by this user (chown it to" in state_dir_finding(tmp_path).said
    assert state_dir_finding(tmp_path / "none").weight is Weight.ERROR
    (tmp_path / "file").touch()
    assert state_dir_finding(tmp_path / "file").said.endswith("/file is no folder (choose another one)")

    monkeypatch.setattr(os, "access", lambda path, how: not how & os.R_OK)  # as /root is for others
    assert state_dir_finding(tmp_path / "none").weight is None


@pytest.mark.root
def test_root_finds_files_that_are_not_those_of_the_folders_owner(tmp_path: Path) -> None:
    for name in ("history.sqlite", "state.sqlite", "state.sqlite.aside-1"):
        (tmp_path / name).touch()
    for path in (tmp_path, *tmp_path.rglob("*")):
        give(path)
    assert state_dir_finding(tmp_path).weight is None

    os.chown(tmp_path / "state.sqlite", 0, 0)

    assert "state.sqlite in it may not be written" in state_dir_finding(tmp_path).text


def test_the_disk_is_measured_where_something_can_be_stored_and_nothing_stays(tmp_path: Path) -> None:
    missing = tmp_path / "none"
    (tmp_path / "doctor.probe").touch()  # of a doctor that was killed

    assert sync_s(missing) is None
    assert not missing.exists()
    assert 0.0 < (sync_s(tmp_path) or 0.0) < 60.0
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("weights", "code", "said"),
    [
        ([None, Weight.NOTE], 0, "no problems\n"),
        ([Weight.WARNING, Weight.NOTE], 1, "0 errors, 1 warning\n"),
        ([Weight.ERROR, Weight.ERROR], 1, "2 errors, 0 warnings\n"),
    ],
)
def test_the_exit_code_says_whether_anything_is_a_problem(
    weights: list[Weight | None], code: int, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    findings = Findings()
    findings.add(*(Finding("line hall", "is odd", weight) for weight in weights))

    assert findings.verdict() == code
    assert capsys.readouterr().out.endswith(said)
