"""Replies that come late, twice or in the wrong order are never taken for another request's answer.

`make test` asks 20,000 times, `make late-replies` ten million times (`tests/line/late_lines.py`).
"""

from __future__ import annotations

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
