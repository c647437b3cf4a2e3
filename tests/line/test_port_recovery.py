"""A port that is open but deaf is opened afresh, ever less often while that is no use, and reported once."""

from __future__ import annotations

import pytest

from gateway.line.port_recovery import ASK_EVERY_S, PortRecovery
from gateway.line.rtu.outcome import Answered, Outcome, Refused, Silent

ANSWERED = Answered((1,), at_s=0.0, response_time_s=0.005)


def cures_s(recovery: PortRecovery, *, until_s: float, outcome: Outcome | None = None) -> list[float]:
    """Return when a port would be opened afresh on which every second brings this outcome."""
    found = []
    for second in range(int(until_s)):
        if recovery.record(outcome or Silent(), float(second)):
            found.append(float(second))
            recovery.begin()
    return found


def test_silence_of_all_is_cured_ever_less_often() -> None:
    assert cures_s(PortRecovery(15.0), until_s=200.0) == [15.0, 46.0, 107.0]


@pytest.mark.parametrize("outcome", [ANSWERED, Refused(2, 0.0)])
def test_any_answer_ends_it(outcome: Outcome) -> None:
    recovery = PortRecovery(15.0)
    assert cures_s(recovery, until_s=16.0) == [15.0]
    assert recovery.is_deaf

    assert not recovery.record(outcome, 20.0)

    assert not recovery.is_deaf
    assert not recovery.record(Silent(), 21.0)
    assert not recovery.record(Silent(), 35.9)
    assert recovery.record(Silent(), 36.0)


def test_who_answers_first_after_a_while_of_silence_makes_everybody_be_asked_again() -> None:
    recovery = PortRecovery(15.0)
    recovery.record(Silent(), 0.0)
    assert not recovery.is_time_to_ask(ASK_EVERY_S - 0.1)
    assert recovery.is_time_to_ask(ASK_EVERY_S)

    recovery.record(ANSWERED, ASK_EVERY_S + 0.1)

    assert [recovery.is_time_to_ask(3.0), recovery.is_time_to_ask(3.0)] == [True, False]
