"""What `doctor` measures of this machine, and what `check` says by it."""

from __future__ import annotations

import asyncio
import json
from dataclasses import replace
from pathlib import Path

import pytest

from gateway.app.capacity import prospects_of
from gateway.cli.doctor.machine import DoctorFinding, judged
from gateway.cli.doctor.speed import BOX_FILE, ROUND_S, WINDOW_S, BoxSpeed, measured, slowness_of
from gateway.cli.main import main
from gateway.config.load import parse
from gateway.families.devices.findings import Weight
from gateway.storage.state_dir import OWN_NAMES
from tests.cli.doctor_site import site

QUICK = BoxSpeed(
    slowness=1.0, processor=1.0, timer_late_s=0.0001, timer_worst_s=0.002, sync_s=0.004, time_s=1.8e9
)
SLOW = replace(QUICK, slowness=20.0)


def remarks(speed: BoxSpeed) -> list[DoctorFinding]:
    return list(judged(speed, prospects_of(parse(full_site(), "site.toml"))))


def full_site(folder: str = "/tmp") -> str:
    """Return a site with one line that is asked without a pause."""
    return site(*["ssw07"] * 8, folder=folder).replace('family = "ssw07"', 'family = "ssw07"\nevery_s = 0')


def test_this_machine_can_be_measured_and_the_measurement_stored(tmp_path: Path) -> None:
    speed = asyncio.run(measured(tmp_path))

    assert 0.05 < speed.slowness < 500.0
    assert 0.0 < speed.processor <= 1.0
    assert 0.0 <= speed.timer_late_s <= speed.timer_worst_s
    assert speed.sync_s is not None
    assert speed.store(tmp_path) == ""
    assert BoxSpeed.load(tmp_path) == speed
    assert [path.name for path in tmp_path.iterdir()] == [BOX_FILE]
    assert OWN_NAMES.fullmatch(BOX_FILE)


class Machine:
    """A processor in virtual time that a program has a share of."""

    def __init__(self, *, share: float, others_until_s: float = 0.0) -> None:
        self.share, self.others_until_s = share, others_until_s
        self.now_s = self.used_s = 0.0

    def work(self, _: int) -> None:
        self.used_s += ROUND_S
        self.now_s += ROUND_S / self.share
        if self.now_s < self.others_until_s:
            self.now_s += 2 * ROUND_S

    def slowness(self) -> tuple[float, float]:
        return slowness_of(self.work, clock=lambda: self.now_s, processor=lambda: self.used_s)


@pytest.mark.parametrize("share", [1.0, 0.5, 0.2])
def test_a_share_of_a_processor_is_measured_as_a_machine_that_is_so_many_times_as_slow(share: float) -> None:
    assert Machine(share=share).slowness() == pytest.approx((1.0 / share, share))


def test_a_program_that_runs_for_a_moment_is_left_out_of_the_measurement() -> None:
    assert Machine(share=1.0, others_until_s=3.5 * WINDOW_S).slowness() == pytest.approx((1.0, 1.0))


def test_where_nothing_can_be_stored_nothing_is_made(tmp_path: Path) -> None:
    missing = tmp_path / "none"

    assert asyncio.run(measured(missing)).sync_s is None
    assert QUICK.store(missing) == ""
    assert not missing.exists()
    assert BoxSpeed.load(missing) is None


def test_where_a_file_stands_in_place_of_state_dir_the_rest_is_measured(tmp_path: Path) -> None:
    file = tmp_path / "state"
    file.touch()

    assert asyncio.run(measured(file)).sync_s is None
    assert QUICK.store(file) == ""
    assert BoxSpeed.load(file) is None


@pytest.mark.parametrize("content", ["{", "[]", "{}", '{"version": 2}', '{"version": 1, "slowness": 1.0}'])
def test_a_measurement_that_cannot_be_read_or_is_of_another_version_is_none(
    content: str, tmp_path: Path
) -> None:
    (tmp_path / BOX_FILE).write_text(content, "utf-8")

    assert BoxSpeed.load(tmp_path) is None


def test_a_machine_that_is_fast_enough_says_what_it_holds() -> None:
    found = remarks(QUICK)

    assert [each.weight for each in found] == [None, None, None]
    assert found[0].text == (
        "holds 13 lines of 32 starters at 19200, asked without a pause; this site takes 8% of a processor"
    )


def test_a_site_that_needs_more_than_the_machine_holds_is_a_problem() -> None:
    found = remarks(SLOW)

    assert found[0].weight is Weight.WARNING
    assert found[0].text.startswith("this site takes 1")
    assert "which holds up to 65%" in found[0].text


def test_a_processor_that_others_use_is_noted() -> None:
    found = remarks(replace(QUICK, processor=0.6))

    assert found[1].weight is Weight.NOTE
    assert "40% of a processor went to other programs meanwhile, or a quota" in found[1].text


def test_late_timers_are_a_problem() -> None:
    (late,) = [each for each in remarks(replace(QUICK, timer_late_s=0.004)) if each.where == "timers"]

    assert late.weight is Weight.WARNING


@pytest.mark.parametrize(
    ("sync_s", "weight"), [(0.2, None), (0.5, Weight.WARNING), (1.5, Weight.ERROR), (None, None)]
)
def test_a_disk_that_makes_starts_wait_is_a_problem(sync_s: float | None, weight: Weight | None) -> None:
    found = [each for each in remarks(replace(QUICK, sync_s=sync_s)) if each.where == "disk"]

    assert [each.weight for each in found] == ([] if sync_s is None else [weight])


@pytest.mark.parametrize(("speed", "is_enough"), [(QUICK, True), (SLOW, False)])
def test_check_says_by_the_last_measurement_whether_this_machine_is_enough(
    speed: BoxSpeed, tmp_path: Path, capsys: pytest.CaptureFixture[str], *, is_enough: bool
) -> None:
    path = tmp_path / "site.toml"
    path.write_text(full_site(str(tmp_path)), "utf-8")
    assert main(["check", str(path)]) == 0
    assert "this machine" not in capsys.readouterr().out  # it was never measured
    speed.store(tmp_path)

    assert main(["check", str(path)]) == 0
    out = capsys.readouterr().out
    assert main(["check", str(path), "--json"]) == 0
    shown = json.loads(capsys.readouterr().out)

    assert "this machine, as `doctor` measured it on 2027-01-15, holds" in out
    assert ("which holds up to 65%" in out) is not is_enough
    assert bool(shown["warnings"]) is not is_enough
    assert shown["machine"]["slowness"] == speed.slowness
