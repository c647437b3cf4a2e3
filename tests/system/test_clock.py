"""Whether the system clock can be trusted."""

from __future__ import annotations

import os
from pathlib import Path
from types import SimpleNamespace

import pytest

from gateway.system.clock import (
    ClockReading,
    ClockWatch,
    Trust,
    is_kernel_clock_synchronised,
    is_synchronised_state,
    kernel_says_synchronised,
)


class Machine:
    """A machine's clocks and its kernel's word; `watch` looks at them four times a second."""

    def __init__(self, trust: Trust = "auto") -> None:
        self.up_s, self.utc_s = 1000.0, 1.8e9
        self.is_synchronised = True  # by a time service
        self.changes: list[str | None] = []
        self.watch = ClockWatch(trust, ask=lambda: self.is_synchronised, read=self.read)
        self.watch.on_change = self.changes.append

    def read(self) -> ClockReading:
        return ClockReading(self.up_s, self.utc_s)

    def wait(self, seconds: float) -> None:
        for _ in range(int(seconds * 4)):
            self.up_s += 0.25
            self.utc_s += 0.25
            self.watch.look()

    def step(self, seconds: float) -> None:
        self.utc_s += seconds
        self.watch.look()


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


@pytest.mark.parametrize("trust", ["auto", "trusted"])
@pytest.mark.parametrize(("step_s", "by"), [(-20.0, "back by 20.0 s"), (20.0, "ahead by 20.0 s")])
def test_after_a_step_the_clock_counts_again_once_it_was_steady_for_a_minute(
    trust: Trust, step_s: float, by: str
) -> None:
    machine = Machine(trust)
    machine.wait(10.0)
    assert machine.watch.doubt() is None

    machine.step(step_s)
    machine.wait(55.0)
    early = machine.watch.doubt()
    machine.wait(10.0)

    assert early == f"this gateway's clock was set {by}, so issued_at does not count for 60 s"
    assert machine.watch.doubt() is None
    assert machine.changes == [f"this gateway's clock was set {by}", None]


def test_many_small_steps_are_one_step() -> None:
    machine = Machine("trusted")

    for _ in range(7):
        machine.step(-0.1)
        machine.wait(10.0)

    assert machine.watch.doubt() is not None


def test_two_readings_that_lie_apart_a_little_are_no_step() -> None:
    machine = Machine("trusted")

    for number in range(1000):
        machine.step(0.2 if number % 2 else -0.2)
        machine.wait(1.0)

    assert machine.watch.doubt() is None


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
