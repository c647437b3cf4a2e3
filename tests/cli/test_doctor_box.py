"""Problems of the machine."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from pydantic import TypeAdapter

from gateway.cli.doctor.machine import (
    clock_remark,
    latency_remark,
    state_dir_remark,
    wear_remarks,
)
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

    remark = latency_remark("/dev/ttyUSB0", "line hall", sysfs=tmp_path)

    assert remark is not None
    assert remark.weight is weight


@pytest.mark.parametrize(("said", "weight"), [(True, None), (False, Weight.WARNING), (None, Weight.NOTE)])
def test_a_clock_that_is_not_synchronised_is_a_problem(said: bool | None, weight: Weight | None) -> None:
    assert clock_remark(lambda: said).weight is weight


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


def test_a_file_in_the_state_directory_that_may_not_be_written_is_a_problem(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("history.sqlite", "state.sqlite", "not-the-gateways"):
        (tmp_path / name).touch()
    assert state_dir_remark(tmp_path).weight is None
    foreign, access = "history.sqlite", os.access
    monkeypatch.setattr(os, "access", lambda path, how: Path(path).name != foreign and access(path, how))

    file = state_dir_remark(tmp_path)

    assert file.weight is Weight.ERROR
    assert f"{tmp_path}/history.sqlite in it may not be written by the gateway's user (chown -R" in file.text
    foreign = "not-the-gateways"
    assert state_dir_remark(tmp_path).weight is None


@pytest.mark.root
def test_root_finds_files_that_are_not_those_of_the_folders_owner(tmp_path: Path) -> None:
    for name in ("history.sqlite", "state.sqlite", "state.sqlite.aside-1"):
        (tmp_path / name).touch()
    for path in (tmp_path, *tmp_path.rglob("*")):
        give(path)
    assert state_dir_remark(tmp_path).weight is None

    os.chown(tmp_path / "state.sqlite", 0, 0)

    assert "state.sqlite in it may not be written" in state_dir_remark(tmp_path).text


def test_how_often_each_memory_was_written_is_reported_and_is_a_problem_when_flash_could_be_worn(
    tmp_path: Path,
) -> None:
    assert wear_remarks(tmp_path) == []

    write_document(tmp_path / STATE_FILE, "writes", WRITES, {"pump": 10000, "fan": 12})

    remarks = wear_remarks(tmp_path)
    assert [(remark.where, remark.weight) for remark in remarks] == [
        ("starter fan", None),
        ("starter pump", Weight.WARNING),
    ]
    assert "has written 12 times" in remarks[0].text


def test_damaged_counts_are_noted(tmp_path: Path) -> None:
    write_document(tmp_path / STATE_FILE, "writes", TypeAdapter(int), 7)

    assert [remark.weight for remark in wear_remarks(tmp_path)] == [Weight.NOTE]
