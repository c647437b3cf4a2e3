"""Whether the system clock can be trusted."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from gateway.clock import ClockWatch, is_kernel_clock_synchronised, is_synchronised_state


def never() -> bool:
    raise AssertionError("asked")


def test_a_clock_is_what_the_configuration_says_whatever_the_kernel_thinks() -> None:
    assert ClockWatch("trusted", ask=never).is_synchronised()
    assert not ClockWatch("untrusted", ask=never).is_synchronised()


def test_the_kernel_is_asked_at_most_every_ten_seconds() -> None:
    now_s, answers = [0.0], [True, False]
    watch = ClockWatch(ask=lambda: answers.pop(0), now_s=lambda: now_s[0])

    assert watch.is_synchronised()
    now_s[0] = 9.9
    assert watch.is_synchronised()
    now_s[0] = 10.0
    assert not watch.is_synchronised()


@pytest.mark.parametrize(
    ("state", "status", "is_synchronised"),
    [
        (0, 0x2001, True),
        (1, 0x2011, True),  # a leap second is to come
        (5, 0x0000, False),  # TIME_ERROR
        (0, 0x0040, False),  # STA_UNSYNC
        (-1, 0x0000, False),  # not permitted
    ],
)
def test_only_a_kernel_that_says_so_has_a_synchronised_clock(
    state: int, status: int, is_synchronised: bool
) -> None:
    assert is_synchronised_state(state, status) is is_synchronised


def test_this_machines_kernel_can_be_asked() -> None:
    assert is_kernel_clock_synchronised() in (True, False)


@pytest.mark.parametrize("age_s", [None, 0.0, 7000.0, 7300.0, -60.0])
def test_where_the_kernel_may_not_be_asked_timesyncds_fresh_mark_does(
    age_s: float | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mark = tmp_path / "synchronized"
    monkeypatch.setattr("ctypes.CDLL", lambda name: object())
    monkeypatch.setattr("gateway.clock.TIMESYNC_MARK", mark)
    monkeypatch.setattr("time.time", lambda: 1e9)
    if age_s is not None:
        mark.touch()
        os.utime(mark, (1e9 - age_s, 1e9 - age_s))

    assert is_kernel_clock_synchronised() is (age_s in (0.0, 7000.0))
