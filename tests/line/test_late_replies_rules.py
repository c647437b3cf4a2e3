"""What a line knows of replies that may still come: debts, copies, orderly and strict lines, series."""

from __future__ import annotations

import pytest

from gateway.line.rtu.late_replies import (
    COPY_S,
    DISTURBED_S,
    LATE_S,
    LOST_AFTER_S,
    LOST_ENOUGH,
    STRICT_S,
    Agreed,
    Choice,
    LateReplies,
    Shape,
    expected_shape,
)
from gateway.modbus.pdu import Request
from gateway.modbus.reads import ReadCoils, ReadHoldingRegisters
from gateway.modbus.writes import WriteRegister

UNIT = 7
STATUS = ReadHoldingRegisters(5001, 1)
COILS = ReadCoils(0, 16)
VALUE = ReadHoldingRegisters(3, 1)  # as long as the status
TWO = ReadHoldingRegisters(3, 2)
ONE_SHAPE, COILS_SHAPE, TWO_SHAPE = expected_shape(STATUS), expected_shape(COILS), expected_shape(TWO)
FORMS = (ONE_SHAPE, COILS_SHAPE)
ONE_REPLY = STATUS.encode_reply((5,))


def owing(*shapes: Shape, asked_s: float = 0.0) -> LateReplies:
    """Return a line whose starter did not answer these requests in time."""
    late = LateReplies()
    for shape in shapes:
        late.note_unanswered(UNIT, shape, asked_s, asked_s + 0.05)
    return late


def orderly(late: LateReplies | None = None, *, from_s: float = 0.0, count: int = LOST_ENOUGH) -> LateReplies:
    """Return a line that lost so many replies in a row; `from_s` + 10 s later it counts them."""
    late = late or LateReplies()
    for _ in range(count):
        late.note_unanswered(UNIT, ONE_SHAPE, from_s, from_s + 0.05)
    late.note_answer(UNIT, COILS, STATUS, COILS.encode_reply((True,) * 16), from_s + 0.1)
    late.is_anyone_late(from_s + LOST_AFTER_S)
    return late


def stray(late: LateReplies, pdu: bytes, *, at_s: float, awaited: Shape | None = None) -> None:
    late.note_stray(UNIT, pdu, began_s=at_s - 0.004, at_s=at_s, awaited=awaited)


# What is owed


def test_what_is_owed_makes_a_read_take_another_form_until_it_came() -> None:
    late = owing(ONE_SHAPE)
    before = late.choose(UNIT, STATUS, FORMS, 1.0)

    stray(late, ONE_REPLY, at_s=2.0)

    assert before == Choice(1)
    assert not late.owes(UNIT)
    assert late.choose(UNIT, STATUS, FORMS, 2.0 + COPY_S) == Choice(0)


def test_what_is_owed_is_forgotten_after_thirty_seconds() -> None:
    late = owing(ONE_SHAPE)

    assert late.choose(UNIT, STATUS, FORMS, LATE_S - 0.001) == Choice(1)
    assert late.choose(UNIT, STATUS, FORMS, LATE_S) == Choice(0)
    assert not late.owes(UNIT)


def test_a_read_without_other_forms_that_decides_nothing_waits() -> None:
    late = owing(ONE_SHAPE)

    assert late.choose(UNIT, VALUE, (ONE_SHAPE,), 1.0, is_decisive=False) is None


def test_an_acknowledgement_that_an_earlier_equal_write_is_owed_is_not_believed() -> None:
    write, other = WriteRegister(3, 1), WriteRegister(3, 2)
    late = owing(expected_shape(write))

    assert late.acknowledges_since_s(UNIT, write, expected_shape(write), 1.0) < 1.0
    assert late.acknowledges_since_s(UNIT, other, expected_shape(other), 1.0) == 1.0


# Copies


@pytest.mark.parametrize(("asked", "may"), [(STATUS, True), (VALUE, False), (TWO, True)])
def test_for_25_ms_after_a_reply_only_another_read_of_its_length_waits(asked: Request, may: bool) -> None:
    late = LateReplies()
    late.note_answer(UNIT, STATUS, STATUS, ONE_REPLY, 1.0)

    chosen = late.choose(UNIT, asked, (expected_shape(asked),), 1.0 + COPY_S - 0.001)

    assert (chosen is not None) == may
    assert late.choose(UNIT, asked, (expected_shape(asked),), 1.0 + COPY_S) == Choice(0)


# Refusals


def test_a_refusal_is_not_believed_while_another_reply_of_that_function_is_owed() -> None:
    late = owing(TWO_SHAPE)

    assert not late.is_refusal_sure(UNIT, STATUS.function, 1.0)
    assert late.is_refusal_sure(UNIT, COILS.function, 1.0)
    assert late.is_refusal_sure(UNIT, STATUS.function, LATE_S)


def test_what_was_refused_in_doubt_is_asked_again_when_nothing_is_owed() -> None:
    late = owing(TWO_SHAPE)
    late.note_refusal_doubted(UNIT, STATUS)

    assert late.choose(UNIT, STATUS, FORMS, 1.0) is None
    assert late.choose(UNIT, STATUS, FORMS, LATE_S) == Choice(0)


# Orderly and strict lines


@pytest.mark.parametrize(("count", "is_orderly"), [(LOST_ENOUGH - 1, False), (LOST_ENOUGH, True)])
def test_thirty_replies_lost_in_a_row_make_a_line_orderly(count: int, is_orderly: bool) -> None:
    assert orderly(count=count).is_orderly(LOST_AFTER_S) == is_orderly


def test_one_reply_out_of_order_makes_a_line_strict_for_ten_minutes() -> None:
    late = orderly()

    stray(late, ONE_REPLY, at_s=12.0)
    again = orderly(late, from_s=100.0)

    assert not again.is_orderly(12.0 + STRICT_S - 0.001)
    assert again.is_orderly(12.0 + STRICT_S)


# Readings that decide something


def test_after_anything_late_two_readings_in_a_row_have_different_shapes_for_a_minute() -> None:
    late = LateReplies()
    stray(late, TWO.encode_reply((1, 2)), at_s=0.0)
    late.note_answer(UNIT, STATUS, STATUS, ONE_REPLY, 1.0)

    assert late.choose(UNIT, STATUS, FORMS, 2.0) == Choice(1)
    assert late.choose(UNIT, STATUS, FORMS, DISTURBED_S) == Choice(0)


@pytest.mark.parametrize("owed", [1, 2, 3])
def test_of_a_form_that_is_owed_n_times_n_and_one_equal_answers_count(owed: int) -> None:
    late = owing(*[ONE_SHAPE] * owed, *[COILS_SHAPE] * 4)
    times = owed + 1

    assert late.choose(UNIT, STATUS, FORMS, 1.0) == Choice(0, times)
    for at in range(owed):
        assert late.agree(UNIT, STATUS, ONE_SHAPE, (5,), 1.0 + 0.1 * at, times) is Agreed.NOT_YET
    assert late.agree(UNIT, STATUS, ONE_SHAPE, (5,), 1.5, times) is Agreed.YES


def test_one_other_answer_ends_a_series() -> None:
    late = owing(ONE_SHAPE, COILS_SHAPE)
    late.agree(UNIT, STATUS, ONE_SHAPE, (5,), 1.0, 2)

    assert late.agree(UNIT, STATUS, ONE_SHAPE, (6,), 1.1, 2) is Agreed.NO
    assert late.agree(UNIT, STATUS, ONE_SHAPE, (6,), 1.2, 2) is Agreed.NOT_YET
