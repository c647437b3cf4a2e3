"""Problems of the machine."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from gateway.cli.doctor.machine import (
    clock_remark,
    clock_state,
    latency_remark,
    state_dir_remark,
    wear_remarks,
)
from gateway.families.devices.findings import Weight


@pytest.mark.parametrize(("milliseconds", "weight"), [("1", None), ("2", None), ("16", Weight.WARNING)])
def test_an_adapter_that_holds_replies_back_is_a_problem(
    milliseconds: str, weight: Weight | None, tmp_path: Path
) -> None:
    device = tmp_path / "ttyUSB0" / "device"
    device.mkdir(parents=True)
    (device / "latency_timer").write_text(f"{milliseconds}\n", "ascii")

    remark = latency_remark("/dev/ttyUSB0", "line hall", sysfs=tmp_path)

    assert remark is not None
    assert remark.weight is weight


def test_an_adapter_without_a_latency_timer_is_no_matter(tmp_path: Path) -> None:
    assert latency_remark("/dev/ttyS0", "line hall", sysfs=tmp_path) is None
    assert latency_remark("socket://box:4001", "line hall", sysfs=tmp_path) is None


@pytest.mark.parametrize(("state", "weight"), [(0, None), (5, Weight.WARNING), (None, Weight.NOTE)])
def test_a_clock_that_is_not_synchronised_is_a_problem(state: int | None, weight: Weight | None) -> None:
    assert clock_remark(lambda: state).weight is weight


def test_the_clock_of_this_machine_can_be_looked_at() -> None:
    assert clock_state() in (None, *range(6))


def test_a_state_directory_must_be_there_and_be_a_folder(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.touch()

    assert state_dir_remark(tmp_path).weight is None
    assert state_dir_remark(file).weight is Weight.ERROR
    assert state_dir_remark(tmp_path / "none").weight is Weight.ERROR


def test_a_state_directory_that_may_not_be_written_is_a_problem(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "access", lambda *_: False)

    assert "chown" in state_dir_remark(tmp_path).text


def test_how_often_each_memory_was_written_is_reported_and_is_a_problem_when_flash_could_be_worn(
    tmp_path: Path,
) -> None:
    assert wear_remarks(tmp_path) == []

    (tmp_path / "wear.json").write_text('{"writes": {"pump": 10000, "fan": 12}}', "utf-8")

    remarks = wear_remarks(tmp_path)
    assert [(remark.where, remark.weight) for remark in remarks] == [
        ("starter fan", None),
        ("starter pump", Weight.WARNING),
    ]
    assert "has written 12 times" in remarks[0].text


def test_damaged_counts_are_noted(tmp_path: Path) -> None:
    (tmp_path / "wear.json").write_text('{"writes": 7}', "utf-8")

    assert [remark.weight for remark in wear_remarks(tmp_path)] == [Weight.NOTE]
