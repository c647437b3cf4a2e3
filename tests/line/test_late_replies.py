"""Replies that come late, twice or in the wrong order are never taken for another request's answer.

`make test` asks 20,000 times, `make late-replies` ten million times (`tests/line/late_lines.py`).
"""

from __future__ import annotations

import pytest

from tests.line.late_lines import ask_for_long, efficiency

TRANSACTIONS = 20_000


def test_no_late_reply_is_taken_for_another_answer() -> None:
    tally = ask_for_long(TRANSACTIONS, seed=0)

    assert tally.examples == []
    assert tally.wrong == 0
    assert tally.asked >= TRANSACTIONS
    assert tally.answered > 0.75 * tally.counts["in time"]  # some only show that a starter is there
    for kind in ("late", "doubled", "late and doubled", "swapped"):
        assert tally.counts[kind] > 0.003 * tally.asked


@pytest.mark.parametrize(("late", "least"), [(0.0, 0.98), (0.05, 0.85)])
def test_a_line_is_used_nearly_as_well_as_can_be(late: float, least: float) -> None:
    tally = efficiency(late, units=32, baud=19200, transactions=3000, seed=1)

    assert tally.wrong == 0
    assert tally.efficiency > least
    assert late or tally.older == tally.alternates == 0  # every request goes out as it is
