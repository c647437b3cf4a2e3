"""Whether the system clock can be trusted."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from gateway.system.clock import (
    ClockWatch,
    Trust,
    is_kernel_clock_synchronised,
    is_synchronised_state,
    kernel_says_synchronised,
    read_clocks,
)
from gateway.system.clock_steps import STEP_S, ClockReading


def never() -> bool:
    raise AssertionError("asked")


class Machine:
    """A machine's clocks and its kernel's word; `watch` looks at them four times a second."""

    def __init__(self, trust: Trust = "auto", *, before: Mapping[str, Any] | None = None) -> None:
        self.up_s, self.utc_s, self.boot_id = 1000.0, 1.8e9, "boot-1"
        self.is_synchronised = True  # by a time service
        self.changes: list[str | None] = []
        self.start(trust, before=before)

    def start(self, trust: Trust = "auto", *, before: Mapping[str, Any] | None = None) -> None:
        """Start the gateway, again."""
        self.watch = ClockWatch(trust, ask=lambda: self.is_synchronised, read=self.read)
        self.watch.recall(before)
        self.watch.on_change = self.changes.append

    def read(self) -> ClockReading:
        return ClockReading(self.up_s, self.utc_s, self.boot_id)

    def wait(self, seconds: float) -> None:
        for _ in range(int(seconds * 4)):
            self.up_s += 0.25
            self.utc_s += 0.25
            self.watch.look()

    def step(self, seconds: float) -> None:
        self.utc_s += seconds
        self.watch.look()

    def reboot(self, *, off_s: float, wrong_s: float = 0.0) -> None:
        """Switch off for so long; the clock is wrong by so much from then on."""
        self.up_s, self.boot_id = 10.0, f"{self.boot_id}+"
        self.utc_s += off_s + wrong_s


def test_a_clock_that_was_never_stepped_is_what_the_configuration_says() -> None:
    assert ClockWatch("trusted", ask=never).doubt() is None
    assert ClockWatch("untrusted", ask=never).doubt() == (
        "the configuration does not trust this gateway's clock (when it is right: "
        'clock = "auto" or "trusted" in [gateway])'
    )


def test_the_kernel_is_asked_at_most_every_ten_seconds() -> None:
    up_s, answers = [0.0], [True, False]
    watch = ClockWatch(ask=lambda: answers.pop(0), read=lambda: ClockReading(up_s[0], 1.8e9 + up_s[0]))

    assert watch.doubt() is None
    up_s[0] = 9.9
    assert watch.doubt() is None
    up_s[0] = 10.0
    assert watch.doubt() == (
        "this gateway's clock is not synchronised (synchronise it; when it is right without: "
        'clock = "trusted" in [gateway])'
    )


@pytest.mark.parametrize(("step_s", "by"), [(-20.0, "back by 20.0 s"), (20.0, "ahead by 20.0 s")])
def test_after_a_step_the_clock_counts_again_once_it_was_synchronised_and_steady_for_a_minute(
    step_s: float, by: str
) -> None:
    machine = Machine()
    machine.wait(10.0)
    assert machine.watch.doubt() is None

    machine.step(step_s)
    machine.is_synchronised = False
    machine.wait(600.0)
    unsynchronised = machine.watch.doubt()
    machine.is_synchronised = True
    machine.wait(55.0)
    early = machine.watch.doubt()
    machine.wait(20.0)

    assert unsynchronised is not None
    assert unsynchronised.startswith(f"this gateway's clock was set {by}, so issued_at does not count")
    assert early == unsynchronised
    assert machine.watch.doubt() is None
    assert machine.changes == [f"this gateway's clock was set {by}", None]


def test_after_a_step_a_trusted_clock_counts_again_once_it_was_steady_for_a_minute() -> None:
    machine = Machine("trusted")
    machine.is_synchronised = False

    machine.step(-20.0)
    machine.wait(55.0)
    early = machine.watch.doubt()
    machine.wait(20.0)

    assert early == "this gateway's clock was set back by 20.0 s, so issued_at does not count for 60 s"
    assert machine.watch.doubt() is None


def test_another_step_begins_the_minute_anew() -> None:
    machine = Machine()
    machine.step(-20.0)
    machine.wait(50.0)

    machine.step(20.0)
    machine.wait(50.0)

    assert machine.watch.doubt() is not None


def test_many_small_steps_are_one_step() -> None:
    machine = Machine("trusted")

    for _ in range(6):
        machine.step(-0.1)
        machine.wait(3600.0 / 6)

    assert machine.changes == ["this gateway's clock was set back by 0.6 s", None]


def test_two_readings_that_lie_apart_a_little_are_no_step() -> None:
    machine = Machine("trusted")

    for number in range(1000):
        machine.step(0.2 if number % 2 else -0.2)
        machine.wait(1.0)

    assert machine.watch.doubt() is None


@pytest.mark.parametrize("is_boot_id_known", [True, False])
@pytest.mark.parametrize(("step_s", "is_seen"), [(-20.0, True), (20.0, True), (0.0, False)])
def test_a_step_while_the_gateway_was_not_running_is_seen(
    step_s: float, is_boot_id_known: bool, is_seen: bool
) -> None:
    machine = Machine("trusted")
    machine.boot_id = "boot-1" if is_boot_id_known else ""
    machine.wait(5.0)
    document = machine.watch.document()

    machine.up_s += 30.0
    machine.utc_s += 30.0 + step_s
    machine.start("trusted", before=document)

    assert (machine.watch.doubt() is not None) is is_seen
    assert (machine.watch.step is not None) is is_seen


@pytest.mark.parametrize(
    ("off_s", "wrong_s", "is_seen"),
    [
        (3600.0, 0.0, False),
        (3600.0, -9 * 86400.0, True),  # nine days off
        (30.0, -1.8e9, True),  # 1970: no clock outlives its power
        (1e7, 0.0, False),
    ],
)
def test_a_clock_that_is_behind_after_a_reboot_is_seen(off_s: float, wrong_s: float, is_seen: bool) -> None:
    machine = Machine("trusted")
    document = machine.watch.document()

    machine.reboot(off_s=off_s, wrong_s=wrong_s)
    machine.start("trusted", before=document)

    assert (machine.watch.doubt() is not None) is is_seen


def test_a_doubt_outlives_the_gateway_and_ends_as_any() -> None:
    machine = Machine()
    machine.step(-20.0)
    document = machine.watch.document()

    machine.start("trusted", before=json.loads(json.dumps(document)))
    restarted = machine.watch.doubt()
    machine.wait(75.0)

    assert restarted is not None
    assert machine.watch.doubt() is None


@pytest.mark.parametrize(
    "document", [{}, {"up_s": "x"}, {"up_s": 1, "utc_s": None, "boot_id": ""}, {"doubt": 5}]
)
def test_what_another_program_left_in_the_file_counts_as_nothing(document: dict[str, Any]) -> None:
    machine = Machine("trusted")

    machine.start("trusted", before=document)

    assert machine.watch.doubt() is None


def test_this_machines_clocks_are_read_as_one() -> None:
    first, second = read_clocks(), read_clocks()

    assert abs(second.offset_s - first.offset_s) < STEP_S
    assert first.boot_id == second.boot_id


@pytest.mark.parametrize(
    ("state", "status", "is_synchronised"),
    [
        (0, 0x2001, True),
        (1, 0x2011, True),  # a leap second is to come
        (5, 0x0000, False),  # TIME_ERROR
        (0, 0x0040, False),  # STA_UNSYNC
    ],
)
def test_only_a_kernel_that_says_so_has_a_synchronised_clock(
    state: int, status: int, is_synchronised: bool
) -> None:
    assert is_synchronised_state(state, status) is is_synchronised


def test_a_kernel_that_may_not_be_asked_says_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ctypes.CDLL", lambda name: SimpleNamespace(adjtimex=lambda timex: -1))

    assert kernel_says_synchronised() is None


def test_this_machines_kernel_can_be_asked() -> None:
    assert is_kernel_clock_synchronised() in (True, False)


@pytest.mark.parametrize("age_s", [None, 0.0, 7000.0, 7300.0, -60.0])
def test_where_the_kernel_may_not_be_asked_timesyncds_fresh_mark_does(
    age_s: float | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mark = tmp_path / "synchronized"
    monkeypatch.setattr("ctypes.CDLL", lambda name: object())
    monkeypatch.setattr("gateway.system.clock.TIMESYNC_MARK", mark)
    monkeypatch.setattr("time.time", lambda: 1e9)
    if age_s is not None:
        mark.touch()
        os.utime(mark, (1e9 - age_s, 1e9 - age_s))

    assert is_kernel_clock_synchronised() is (age_s in (0.0, 7000.0))
