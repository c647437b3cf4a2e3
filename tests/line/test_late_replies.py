"""Replies that come late, twice or in the wrong order are never taken for another request's answer.

`make test` asks 200,000 times, `make late-replies` ten million times (`tests/line/late_lines.py`).
"""

from __future__ import annotations

import random

import pytest

from gateway.line.rtu.bus_faults import LATE_OR_TWICE
from tests.line.late_lines import BAUDS, Line, ask_for_long, efficiency
from tests.line.late_wire import Faults

TRANSACTIONS = 200_000
SEEDS = 5


@pytest.mark.parametrize("seed", range(SEEDS))
def test_no_late_reply_is_taken_for_another_answer(seed: int) -> None:
    tally = ask_for_long(TRANSACTIONS // SEEDS, seed=seed)

    assert tally.examples == []
    assert tally.wrong == 0
    assert tally.asked >= TRANSACTIONS // SEEDS
    assert tally.answered > 0.75 * tally.counts["in time"]  # some only show that a starter is there
    for kind in ("late", "doubled", "late and doubled", "swapped"):
        assert tally.counts[kind] > 0.003 * tally.asked


@pytest.mark.parametrize("units", [1, 2, 8, 32])
@pytest.mark.parametrize("stalls", [False, True])
def test_late_doubled_and_swapped_replies_are_named_as_such_and_accuse_no_address(
    units: int, *, stalls: bool
) -> None:
    line = Line(random.Random(units), Faults(0.05, stalls=stalls), units=units, baud=19200, every_s=0.0)
    line.ask(5000)

    assert {fault.text for fault in line.faults()} == {LATE_OR_TWICE}


def test_nothing_that_a_way_over_tcp_holds_back_is_taken_for_an_answer() -> None:
    faults = Faults(0.03, stalls=True)
    tallies = [
        Line(random.Random(units), faults, units=units, baud=19200, every_s=0.2).ask(5000)
        for units in (1, 8, 32)
    ]

    assert all(tally.wrong == 0 for tally in tallies)
    assert sum(tally.counts["stalls"] for tally in tallies) >= 3


@pytest.mark.parametrize("baud", BAUDS)
@pytest.mark.parametrize("units", [32, 247])
def test_without_faults_every_request_goes_out_as_it_is(units: int, baud: int) -> None:
    tally = efficiency(0.0, units=units, baud=baud, transactions=3000, seed=1)

    assert tally.wrong == tally.older == tally.alternates == 0
    assert tally.efficiency > 0.98


@pytest.mark.parametrize("baud", BAUDS)
@pytest.mark.parametrize("units", [32, 247])
def test_with_one_reply_in_twenty_late_a_line_is_used_nearly_as_well_as_can_be(units: int, baud: int) -> None:
    tally = efficiency(0.05, units=units, baud=baud, transactions=5000, seed=2)

    assert tally.wrong == 0
    assert tally.efficiency > 0.85
