from __future__ import annotations

import pytest

from gateway.line.rtu.outcome import Answered, Garbled, Outcome, Refused, Silent
from gateway.line.scheduler.requests import Poll
from gateway.line.scheduler.units import ScheduledPoll, Unit, UnitState
from gateway.modbus.adu import encode
from gateway.modbus.reads import ReadHoldingRegisters

ANSWERED = Answered((1,), at_s=0.0, response_time_s=0.005)
GARBLED = Garbled("bad CRC", b"\x01")


def state_after(*outcomes: Outcome) -> UnitState:
    unit = Unit(number=1)
    for outcome in outcomes:
        unit.note(outcome, 0.0)
    return unit.state


@pytest.mark.parametrize(
    ("outcomes", "state"),
    [
        ([], UnitState.NEW),
        ([ANSWERED], UnitState.ANSWERING),
        ([Refused(2, 0.0)], UnitState.ANSWERING),
        ([Silent()], UnitState.SUSPECT),
        ([Silent(), Silent()], UnitState.SILENT),
        ([ANSWERED, Silent()], UnitState.SUSPECT),
        ([ANSWERED, Silent(), ANSWERED, Silent()], UnitState.SUSPECT),
        ([Silent(), Silent(), Silent(), ANSWERED], UnitState.ANSWERING),
        ([GARBLED], UnitState.SUSPECT),  # the first of two in a row is not noted: it is repeated
        ([GARBLED, ANSWERED], UnitState.ANSWERING),
        ([GARBLED, Silent()], UnitState.SILENT),
        ([Silent("port closed", is_sent=False)] * 3, UnitState.NEW),
    ],
)
def test_a_unit_is_silent_after_two_misses_and_answers_after_one_answer(
    outcomes: list[Outcome], state: UnitState
) -> None:
    assert state_after(*outcomes) is state


def test_a_unit_is_offline_after_four_misses_unless_its_silence_is_expected() -> None:
    unit = Unit(number=1, forgiven_until_s=5.0)
    news = []
    for at_s in (1.0, 2.0, 3.0, 4.0, 4.9, 5.0, 6.0):
        assert unit.note(Silent(), at_s) is False
        news.append(unit.news())

    assert news == [None, None, None, None, None, None, False]
    assert unit.note(ANSWERED, 7.0)
    assert unit.news() is True


def misses(unit: Unit, first_s: float, count: int, *, late: bool) -> list[bool | None]:
    """Let it miss once a second, each reply coming too late or never; return what is reported."""
    news = []
    for at_s in range(int(first_s), int(first_s) + count):
        if late:
            unit.note_late(at_s)
        unit.note(Silent(), at_s)
        news.append(unit.news())
    return news


def test_a_unit_whose_replies_only_come_late_is_not_offline_for_half_a_minute() -> None:
    unit = Unit(number=1)
    unit.note(ANSWERED, 0.0)
    unit.news()

    assert misses(unit, 1.0, 29, late=True) == [None] * 29
    assert unit.is_silent
    assert False in misses(unit, 31.0, 4, late=True)


def test_a_unit_that_never_answered_in_time_is_offline_whatever_comes_late() -> None:
    assert False in misses(Unit(number=1), 1.0, 4, late=True)


def test_a_right_frame_that_answers_something_else_shows_that_the_unit_is_there() -> None:
    unit, other = Unit(number=1), encode(1, b"\x83\x01")
    unit.note(ANSWERED, 0.0)
    unit.news()

    for at_s in (1.0, 2.0, 3.0, 4.0, 5.0):
        unit.note(Garbled("it may be the refusal of an earlier request", other), at_s)
        assert unit.news() is None

    unit.note(Garbled("another unit", encode(2, b"\x83\x01")), 6.0)
    unit.note(Garbled("another unit", encode(2, b"\x83\x01")), 9.0)
    assert unit.news() is None  # for 5 s after it there are three misses at most
    unit.note(Garbled("another unit", encode(2, b"\x83\x01")), 10.0)
    assert unit.news() is False


def test_a_silent_unit_whose_watchdog_is_shorter_than_its_period_is_asked_before_that_acts() -> None:
    unit = Unit(number=1, limit_s=2.6, received_s=0.0)
    poll = Poll("a", 1, ReadHoldingRegisters(0, 1), 5.0, 0.01)
    unit.polls.append(ScheduledPoll(poll=poll, unit=unit, every_s=5.0))

    assert [unit.pause_s(now_s) for now_s in (0.1, 2.0, 60.0)] == [1.0, 1.0, 1.0]
    unit.limit_s = 0.0
    assert unit.pause_s(0.1) == 5.0
