"""What `doctor` measures of this machine."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from pathlib import Path

import pytest

from gateway.cli.doctor.doctor import verdict
from gateway.cli.doctor.machine import DoctorFinding, judged
from gateway.cli.doctor.speed import BoxSpeed, measured
from gateway.families.devices.findings import Weight

QUICK = BoxSpeed(timer_late_s=0.0001, timer_worst_s=0.002, sync_s=0.004)


def test_this_machine_can_be_measured_and_nothing_of_it_stays(tmp_path: Path) -> None:
    speed = asyncio.run(measured(tmp_path))

    assert 0.0 <= speed.timer_late_s <= speed.timer_worst_s
    assert speed.sync_s is not None
    assert list(tmp_path.iterdir()) == []


def test_where_nothing_can_be_stored_the_disk_is_not_measured(tmp_path: Path) -> None:
    missing, file = tmp_path / "none", tmp_path / "state"
    file.touch()

    assert asyncio.run(measured(missing)).sync_s is None
    assert asyncio.run(measured(file)).sync_s is None
    assert not missing.exists()


def test_late_timers_are_a_problem() -> None:
    (late,) = [each for each in judged(replace(QUICK, timer_late_s=0.004)) if each.where == "timers"]

    assert late.weight is Weight.WARNING


@pytest.mark.parametrize(
    ("sync_s", "weight"), [(0.2, None), (0.5, Weight.WARNING), (1.5, Weight.ERROR), (None, None)]
)
def test_a_disk_that_makes_starts_wait_is_a_problem(sync_s: float | None, weight: Weight | None) -> None:
    found = [each for each in judged(replace(QUICK, sync_s=sync_s)) if each.where == "disk"]

    assert [each.weight for each in found] == ([] if sync_s is None else [weight])


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
    assert verdict([DoctorFinding("line hall", "is odd", weight) for weight in weights]) == code
    assert capsys.readouterr().out == said
