"""Whether the system clock can be trusted; what it means for commands: tests/scenarios/broker."""

from __future__ import annotations

import os
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from gateway.system.clock import (
    ClockReading,
    ClockWatch,
    is_kernel_clock_synchronised,
    kernel_says_synchronised,
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


@pytest.mark.parametrize(
    ("steps_s", "doubt"),
    [
        ([-0.1] * 6, "back by 0.6 s"),  # many small steps are one
        ([0.2, -0.2] * 500, None),  # two readings lie apart a little
        ([3.0], "ahead by 3.0 s"),
    ],
)
def test_a_step_is_what_the_difference_of_both_clocks_shows(steps_s: list[float], doubt: str | None) -> None:
    up_s, offset_s, said = 1000.0, 1.8e9, []
    watch = ClockWatch("trusted", read=lambda: ClockReading(up_s, offset_s + up_s))
    watch.on_change = said.append
    watch.look()
    for step_s in steps_s:
        up_s, offset_s = up_s + 1.0, offset_s + step_s
        watch.look()

    assert said == ([] if doubt is None else [f"this gateway's clock was set {doubt}"])
    assert (watch.doubt() is None) == (doubt is None)
    up_s += 59.0
    watch.look()
    assert len(said) == (doubt is not None)
    up_s += 1.0
    watch.look()
    assert said[1:] == ([] if doubt is None else [None])
    assert watch.doubt() is None


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
    state: int, status: int, *, is_synchronised: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    def adjtimex(timex: Any) -> int:
        timex.status = status
        return state

    monkeypatch.setattr("ctypes.CDLL", lambda name: SimpleNamespace(adjtimex=adjtimex))
    monkeypatch.setattr("ctypes.byref", lambda timex: timex)

    assert is_kernel_clock_synchronised() is is_synchronised


@pytest.mark.parametrize("age_s", [None, 0.0, 7000.0, 7300.0, -60.0])
def test_where_the_kernel_may_not_be_asked_timesyncds_fresh_mark_does(
    age_s: float | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mark = tmp_path / "synchronized"
    monkeypatch.setattr("ctypes.CDLL", lambda name: SimpleNamespace(adjtimex=lambda timex: -1))
    monkeypatch.setattr("gateway.system.clock.TIMESYNC_MARK", mark)
    monkeypatch.setattr("time.time", lambda: 1e9)
    if age_s is not None:
        mark.touch()
        os.utime(mark, (1e9 - age_s, 1e9 - age_s))

    assert kernel_says_synchronised() is None
    assert is_kernel_clock_synchronised() is (age_s in (0.0, 7000.0))
