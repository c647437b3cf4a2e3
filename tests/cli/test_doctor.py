"""What `doctor` finds in a machine."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from pydantic import TypeAdapter

from gateway.cli.doctor.findings import Finding, Findings
from gateway.cli.doctor.machine import (
    clock_finding,
    disk_finding,
    latency_finding,
    state_dir_finding,
    sync_s,
    timers_finding,
    wear_findings,
)
from gateway.cli.doctor.starters import telegrams_finding
from gateway.families.devices.findings import Weight
from gateway.starters import WRITES
from gateway.store import STATE_FILE, write_document
from tests.ordinary_user import give


@pytest.mark.parametrize(("milliseconds", "weight"), [("1", None), ("2", None), ("16", Weight.WARNING)])
def test_an_adapter_that_holds_replies_back_is_a_problem(
    milliseconds: str, weight: Weight | None, tmp_path: Path
) -> None:
    device = tmp_path / "ttyUSB0" / "device"
    device.mkdir(parents=True)
    (device / "latency_timer").write_text(f"{milliseconds}\n", "ascii")

    finding = latency_finding("/dev/ttyUSB0", "line hall", sysfs=tmp_path)

    assert finding is not None
    assert finding.weight is weight


@pytest.mark.parametrize(("said", "weight"), [(True, None), (False, Weight.WARNING), (None, Weight.NOTE)])
def test_a_clock_that_is_not_synchronised_is_a_problem(said: bool | None, weight: Weight | None) -> None:
    assert clock_finding(lambda: said).weight is weight


def test_a_state_directory_must_be_there_and_be_a_folder(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.touch()

    assert state_dir_finding(tmp_path).weight is None
    assert state_dir_finding(file).weight is Weight.ERROR
    there_soon = state_dir_finding(tmp_path / "new" / "state")
    assert (there_soon.weight, "`run` makes it" in there_soon.text) == (None, True)
    assert state_dir_finding(file / "none").weight is Weight.ERROR


def test_a_state_directory_that_may_not_be_written_is_a_problem(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "access", lambda *_: False)

    assert "chown" in state_dir_finding(tmp_path).remedy
    assert state_dir_finding(tmp_path / "none").weight is Weight.ERROR


def test_a_file_in_the_state_directory_that_may_not_be_written_is_a_problem(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("history.sqlite", "state.sqlite", "not-the-gateways"):
        (tmp_path / name).touch()
    assert state_dir_finding(tmp_path).weight is None
    foreign, access = "history.sqlite", os.access
    monkeypatch.setattr(os, "access", lambda path, how: Path(path).name != foreign and access(path, how))

    file = state_dir_finding(tmp_path)

    assert file.weight is Weight.ERROR
    assert f"{tmp_path}/history.sqlite in it may not be written by the gateway's user (chown -R" in file.said
    foreign = "not-the-gateways"
    assert state_dir_finding(tmp_path).weight is None


@pytest.mark.root
def test_root_finds_files_that_are_not_those_of_the_folders_owner(tmp_path: Path) -> None:
    for name in ("history.sqlite", "state.sqlite", "state.sqlite.aside-1"):
        (tmp_path / name).touch()
    for path in (tmp_path, *tmp_path.rglob("*")):
        give(path)
    assert state_dir_finding(tmp_path).weight is None

    os.chown(tmp_path / "state.sqlite", 0, 0)

    assert "state.sqlite in it may not be written" in state_dir_finding(tmp_path).text


def test_how_often_each_memory_was_written_is_reported_and_is_a_problem_when_flash_could_be_worn(
    tmp_path: Path,
) -> None:
    assert list(wear_findings(tmp_path)) == []

    write_document(tmp_path / STATE_FILE, "writes", WRITES, {"pump": 10000, "fan": 12})

    found = list(wear_findings(tmp_path))
    assert [(finding.where, finding.weight) for finding in found] == [
        ("starter fan", None),
        ("starter pump", Weight.WARNING),
    ]
    assert "has written 12 times" in found[0].text


def test_damaged_counts_are_noted(tmp_path: Path) -> None:
    write_document(tmp_path / STATE_FILE, "writes", TypeAdapter(int), 7)

    assert [finding.weight for finding in list(wear_findings(tmp_path))] == [Weight.NOTE]


def test_the_disk_is_measured_where_something_can_be_stored_and_nothing_stays(tmp_path: Path) -> None:
    missing = tmp_path / "none"

    assert sync_s(missing) is None
    assert not missing.exists()
    assert 0.0 < (sync_s(tmp_path) or 0.0) < 60.0
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("finding", "weight"),
    [
        (timers_finding(0.0001, 0.002), None),
        (timers_finding(0.004, 0.004), Weight.WARNING),
        (disk_finding(0.2), None),
        (disk_finding(0.5), Weight.WARNING),
        (disk_finding(1.5), Weight.ERROR),
        (telegrams_finding("mill", 5000, 5000, 0, 0), None),
        (telegrams_finding("mill", 5000, 4950, 50, 0), Weight.NOTE),
        (telegrams_finding("mill", 5000, 4949, 51, 0), Weight.WARNING),
        (telegrams_finding("mill", 3, 3, 0, 7), Weight.NOTE),
        (telegrams_finding("mill", 3, 3, 10, 0), Weight.NOTE),  # as after 65,536 requests
    ],
)
def test_late_timers_slow_disks_and_bad_cables_are_problems(finding: Finding, weight: Weight | None) -> None:
    assert finding.weight is weight


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
