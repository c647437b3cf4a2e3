"""Whether the system clock can be trusted."""

from __future__ import annotations

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


def test_a_kernel_that_cannot_be_asked_vouches_for_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ctypes.CDLL", lambda name: object())

    assert not is_kernel_clock_synchronised()
