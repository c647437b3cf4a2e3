"""The units' communication watchdogs: met whenever they can be, whatever else is asked of the line."""

from __future__ import annotations

from dataclasses import replace

from gateway.line.rtu.outcome import Silent
from gateway.line.scheduler.scheduler import IN_ROW
from gateway.line.scheduler.units import UnitState
from tests.line.fakes import poll
from tests.line.ideal_line import IdealLine
from tests.line.scheduled import ANSWERED, begun, key_of, take


def test_when_the_watchdogs_alone_would_fill_the_line_others_have_a_slot_now_and_then() -> None:
    polls = [replace(poll(f"{unit}", unit=unit, every_s=60.0), deadline_s=0.2) for unit in range(1, 11)]
    line = IdealLine([*polls, poll("other", unit=11, every_s=1.0)], lambda slot: 0.05)

    line.run(20.0)

    keys = [key_of(slot) for _, slot in line.slots]
    assert max(line.gaps_s["other"]) < 2.0
    assert len(keys) - keys.count("other") > 0.9 * IN_ROW / (IN_ROW + 1) * len(keys)


def test_the_watchdog_with_the_least_margin_lately_is_reported_and_what_all_of_them_need() -> None:
    scheduler = begun(
        replace(poll("a", unit=1, every_s=60.0), deadline_s=10.0),
        replace(poll("b", unit=2, every_s=1.0), deadline_s=10.0),
    )
    for now_s in (0.0, 0.1):
        slot = scheduler.pick(now_s)
        assert slot is not None
        scheduler.record(slot, ANSWERED, now_s + 0.1)
    assert scheduler.polls.watchdog_statistics(0.2) == {"load": 0.02, "longest_share": 0.0, "unit": 0}

    take(scheduler, 12.0)
    take(scheduler, 12.1)

    assert scheduler.polls.watchdog_statistics(12.1)["longest_share"] == 1.2
    assert scheduler.polls.watchdog_statistics(70.0)["longest_share"] == 1.2
    assert scheduler.polls.watchdog_statistics(140.0)["longest_share"] == 0.0


def test_a_unit_that_was_silent_has_not_been_left() -> None:
    scheduler = begun(replace(poll("a", every_s=1.0), deadline_s=2.0))
    take(scheduler, 0.0)
    take(scheduler, 1.0, Silent())
    take(scheduler, 2.0, Silent())
    assert scheduler.polls.watchdog_statistics(3.0)["load"] == 0.0

    take(scheduler, 50.0)

    assert scheduler.polls.watchdog_statistics(50.0)["longest_share"] == 0.0


def test_a_watchdog_that_becomes_known_has_counted_since_the_unit_was_reached_last() -> None:
    scheduler = begun(poll("a", every_s=60.0))
    take(scheduler, 0.0)

    scheduler.polls.set_deadline(1, 10.0)

    assert scheduler.next_due_s() == 5.0
    assert key_of(take(scheduler, 5.0)) == "a"


def test_a_watchdog_of_a_unit_that_went_silent_waits_until_it_is_reached_again() -> None:
    scheduler = begun(poll("a", every_s=60.0))
    take(scheduler, 0.0)
    for now_s in (60.0, 61.0, 62.0, 63.0, 64.0, 65.0):
        scheduler.polls.expedite("a", now_s)
        take(scheduler, now_s, Silent("no reply"))
    assert scheduler.polls.unit(1).state is UnitState.SILENT

    scheduler.polls.set_deadline(1, 10.0)

    assert scheduler.next_due_s() > 65.0
