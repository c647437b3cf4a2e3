"""Replies that come late, twice or in the wrong order are never taken for another request's answer.

`make test` asks 100,000 times; LATE_REPLIES=1000000 (`make late-replies`) asks as often as that.
"""

from __future__ import annotations

import os

import pytest

from tests.line.late_lines import ask_for_long

TRANSACTIONS = int(os.environ.get("LATE_REPLIES", "100000"))
SEEDS = 5


@pytest.mark.parametrize("seed", range(SEEDS))
def test_no_late_reply_is_taken_for_another_answer(seed: int) -> None:
    tally = ask_for_long(TRANSACTIONS // SEEDS, seed=seed)

    assert tally.wrong == 0
    assert tally.asked >= TRANSACTIONS // SEEDS
    assert tally.answered > 0.9 * tally.counts["in time"]
    for kind in ("late", "doubled", "late and doubled", "swapped"):
        assert tally.counts[kind] > 0.005 * tally.asked
