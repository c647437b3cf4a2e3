from __future__ import annotations

import pytest

from gateway.line.rtu.outcome import Answered, Garbled, Outcome, Refused, Silent
from gateway.line.scheduler.units import Unit, UnitState

ANSWERED = Answered((1,), at_s=0.0, response_time_s=0.005)
GARBLED = Garbled("bad CRC", b"\x01")


def state_after(*outcomes: Outcome) -> UnitState:
    unit = Unit(number=1)
    for outcome in outcomes:
        unit.note(outcome, sent_s=0.0, now_s=0.0)
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
        assert unit.note(Silent(), sent_s=at_s, now_s=at_s) is False
        news.append(unit.news())

    assert news == [None, None, None, None, None, None, False]
    assert unit.note(ANSWERED, sent_s=7.0, now_s=7.0)
    assert unit.news() is True
