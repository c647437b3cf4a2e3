"""How many equal answers count where earlier replies would pass for the next."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from gateway.line.prepared import Prepared
from gateway.line.rtu.agreement import PATIENCE_S, PAUSES_S, UNDER_WAY_S, Agreed, Agreement
from gateway.modbus.reads import ReadHoldingRegisters

FORM = replace(Prepared.of(1, ReadHoldingRegisters(0, 1)), times=3)


def taken(agreement: Agreement, *values: Any, key: str = "a", sent: int = 1) -> list[Agreed]:
    return [
        agreement.take(FORM, key, value, sent=sent + at, now_s=0.1 * at) for at, value in enumerate(values)
    ]


def test_with_two_owed_the_third_equal_answer_counts() -> None:
    assert taken(Agreement(), 5, 5, 5) == [Agreed.NOT_YET, Agreed.NOT_YET, Agreed.YES]


def test_an_answer_that_differs_ends_the_series_and_the_next_begins_anew() -> None:
    agreement = Agreement()

    assert taken(agreement, 5, 5, 6)[-1] is Agreed.NO
    assert taken(agreement, 5, 5, 5, sent=4) == [Agreed.NOT_YET, Agreed.NOT_YET, Agreed.YES]


def test_another_request_of_the_same_form_in_between_begins_the_series_anew() -> None:
    agreement = Agreement()
    taken(agreement, 5, 5)

    assert taken(agreement, 5, sent=4) == [Agreed.NOT_YET]
    assert taken(agreement, 5, 5, sent=5) == [Agreed.NOT_YET, Agreed.YES]


def test_nobody_else_is_asked_in_the_form_of_a_series_that_is_under_way() -> None:
    agreement = Agreement()
    taken(agreement, 5)

    assert agreement.may_ask(FORM, "a", 0.1, is_decisive=True)
    assert not agreement.may_ask(FORM, "b", 0.1, is_decisive=True)
    assert agreement.may_ask(FORM, "b", UNDER_WAY_S, is_decisive=True)


def test_what_changes_all_the_time_is_tried_ever_less_often() -> None:
    agreement = Agreement()

    for number, pause_s in enumerate((*PAUSES_S, PAUSES_S[-1])):
        assert taken(agreement, 5, 6, sent=10 * number)[-1] is Agreed.NO
        assert not agreement.may_ask(FORM, "a", 0.1 + pause_s - 0.01, is_decisive=True)
        assert agreement.may_ask(FORM, "a", 0.1 + pause_s + 0.01, is_decisive=True)


def test_what_decides_nothing_waits_for_the_late_reply_at_first() -> None:
    agreement = Agreement()
    looks = [
        agreement.may_ask(FORM, "a", 0.5 * at, is_decisive=False) for at in range(int(2 * PATIENCE_S) + 1)
    ]

    assert looks == [False] * int(2 * PATIENCE_S) + [True]
    assert not agreement.may_ask(FORM, "a", 60.0, is_decisive=False)
