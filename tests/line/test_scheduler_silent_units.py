"""Units that do not answer, and lines on which none could be received."""

from __future__ import annotations

import random
from dataclasses import replace

import pytest

from gateway.line.rtu.outcome import Silent
from tests.line.fakes import poll
from tests.line.scheduled import ANSWERED, ask_times, begun, gaps, take


def test_a_silent_unit_is_asked_ever_less_often_up_to_the_ceiling() -> None:
    scheduler = begun(poll("a", every_s=1.0))

    asked_s = ask_times(scheduler, [Silent()] * 9)

    assert gaps(asked_s) == [1.0, 1.0, 2.0, 4.0, 8.0, 16.0, 16.0, 16.0]


@pytest.mark.parametrize(
    ("every_s", "expected"), [(0.0, [0.0, 1.0, 1.0]), (5.0, [5.0, 5.0, 10.0]), (60.0, [60.0] * 3)]
)
def test_the_back_off_begins_at_the_polls_own_period(every_s: float, expected: list[float]) -> None:
    scheduler = begun(poll("a", every_s=every_s))

    assert gaps(ask_times(scheduler, [Silent()] * 4)) == expected


def test_a_unit_with_a_watchdog_is_asked_often_enough_for_it_as_it_may_receive_though_we_do_not() -> None:
    scheduler = begun(replace(poll("a", every_s=1.0), deadline_s=10.0))

    assert max(gaps(ask_times(scheduler, [Silent()] * 9))) == 1.25


def test_the_back_off_is_spread_by_a_tenth_either_way() -> None:
    scheduler = begun(poll("a", every_s=1.0), chance=random.Random(7))

    late = gaps(ask_times(scheduler, [Silent()] * 200))[6:]

    assert min(late) >= 14.4
    assert max(late) <= 17.6
    assert max(late) - min(late) > 2.0


def test_an_expected_silence_is_not_reported_and_asks_only_the_probe() -> None:
    scheduler = begun(poll("status", every_s=0.2), poll("current", every_s=0.2))
    take(scheduler, 0.0)
    take(scheduler, 0.0)
    scheduler.polls.unit(1).expect_silence(10.0)

    times_s = ask_times(scheduler, [Silent()] * 10)

    assert gaps(times_s) == pytest.approx([0.0, *([1.0] * 8)])
    assert scheduler.polls.unit(1).is_online
    assert take(scheduler, 10.3, ANSWERED) is not None
    assert len(scheduler.polls.asked()) == 2


def test_when_no_unit_could_be_received_all_are_asked_at_once() -> None:
    scheduler = begun(*(poll(f"{unit}", unit=unit) for unit in range(1, 31)))
    now_s, slot = 0.0, None
    while now_s < 60.0 or slot is None:  # until a probe has just used up their share of the line's time
        slot = scheduler.pick(now_s)
        now_s = now_s + 0.1 if slot is not None else scheduler.next_due_s()
        if slot is not None:
            scheduler.record(slot, Silent(), now_s)

    scheduler.polls.expedite_all(now_s)

    answered = set()
    for _ in range(30):
        slot = take(scheduler, now_s)
        assert slot is not None
        answered.add(slot.unit)
    assert answered == set(range(1, 31))
