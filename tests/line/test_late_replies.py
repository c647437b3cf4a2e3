"""Replies that come late, twice or in the wrong order are never taken for another request's answer.

`make test` asks 20,000 times, `make late-replies` ten million times (`tests/line/late_lines.py`).
"""

from __future__ import annotations

from gateway.line.rtu.late_replies import COPY_S, Choice, LateReplies, expected_shape
from gateway.modbus.reads import ReadCoils, ReadHoldingRegisters
from tests.line.late_lines import ask_for_long

TRANSACTIONS = 20_000


def test_no_late_reply_is_taken_for_another_answer() -> None:
    tally = ask_for_long(TRANSACTIONS, seed=0)

    assert tally.examples == []
    assert tally.wrong == 0
    assert tally.asked >= TRANSACTIONS
    assert tally.answered > 0.75 * tally.counts["in time"]  # some only show that a starter is there
    for kind in ("late", "doubled", "late and doubled", "swapped"):
        assert tally.counts[kind] > 0.003 * tally.asked


def test_what_is_owed_makes_a_read_take_another_form_until_it_came() -> None:
    status, coils = ReadHoldingRegisters(5001, 1), ReadCoils(0, 16)
    forms = (expected_shape(status), expected_shape(coils))
    late = LateReplies()
    late.note_unanswered(7, forms[0], 0.0, 0.05)
    before = late.choose(7, status, forms, 1.0)

    late.note_stray(7, status.encode_reply((5,)), began_s=1.996, at_s=2.0, awaited=None)

    assert before == Choice(1)
    assert late.choose(7, status, forms, 2.0 + COPY_S) == Choice(0)
