from __future__ import annotations

import itertools

import pytest

from gateway.line.rtu.outcome import Answered, Garbled, Outcome, Refused, Silent
from gateway.line.scheduler.units import TRANSITIONS, Evidence, UnitHealth, UnitState

ANSWERED = Answered((1,), at_s=0.0, response_time_s=0.005)
GARBLED = Garbled("bad CRC", b"\x01")


def state_after(*outcomes: Outcome) -> UnitState:
    health = UnitHealth()
    for outcome in outcomes:
        health.take(outcome, 0.0)
    return health.state


def test_the_table_lists_every_pair() -> None:
    assert set(TRANSITIONS) == set(itertools.product(UnitState, Evidence))


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
        ([GARBLED], UnitState.NEW),
        ([GARBLED, ANSWERED, GARBLED], UnitState.ANSWERING),
        ([GARBLED, Silent(), GARBLED], UnitState.SUSPECT),
        ([GARBLED, GARBLED], UnitState.SUSPECT),
        ([GARBLED, GARBLED, GARBLED], UnitState.SILENT),
        ([Silent("port closed", is_sent=False)] * 3, UnitState.NEW),
    ],
)
def test_a_unit_is_silent_after_two_misses_and_answers_after_one_answer(
    outcomes: list[Outcome], state: UnitState
) -> None:
    assert state_after(*outcomes) is state


def test_an_expected_silence_does_not_count() -> None:
    health = UnitHealth()
    health.expect_silence(5.0)
    health.expect_silence(3.0)  # does not shorten it

    signs = [health.take(Silent(), at_s) for at_s in (1.0, 2.0, 4.9)]

    assert signs == [Evidence.MISS] * 3
    assert health.state is UnitState.NEW
    health.take(Silent(), 5.0)
    assert health.state is UnitState.SUSPECT
