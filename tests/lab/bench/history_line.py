"""What the history costs a line in real time: pairs of spans with and without it, in one run (ABBA).

The gateway polls SSW900s without a pause; what is stopped is started again at its keypad, so that starts are
recorded all the time.
"""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager

from gateway.storage.history import read_history
from tests.lab.bench.judge import Spec
from tests.lab.bench.page import HEAD, PagedSite, Plan, compared, listed
from tests.lab.bench.plant import name
from tests.lab.bench.report import Goal, table
from tests.lab.bench.rows import BenchRow

UNITS = 32
PAIRS = 6
SPAN_S = 15.0
STOPS = 12  # in each span
RESTARTS_S = 1.0
PLAN = Plan(
    spec=Spec(units=UNITS, family="ssw900", restarts_s=RESTARTS_S),
    are_busy=(False, True, True, False) * (PAIRS // 2),
    span_s=SPAN_S,
    stops=STOPS,
    module="tests.lab.bench.switched",
)


def history_line() -> BenchRow:
    """Efficiency, silences, stops and the longest time without a request, with the history and without."""
    starts: list[int] = []
    rows, goals, ratios, _ = compared("history", lambda site: _switched_on(site, starts), PLAN)
    goals.append(Goal("starts recorded", starts[-1], 10))
    note = (
        f"{PAIRS} pairs of {SPAN_S:g} s (ABBA), {UNITS} SSW900s, 19200; the history is switched in one run."
        f"\nWith / alone: {listed(ratios)}. {starts[-1]} starts were recorded meanwhile."
    )
    return BenchRow(table("What the history costs", HEAD, rows, note=note), goals)


@contextmanager
def _switched_on(site: PagedSite, starts: list[int]) -> Iterator[None]:
    """Switch the history on, and off again; note how many starts it has."""
    site.process.send(signal.SIGUSR1)
    try:
        yield
    finally:
        site.process.send(signal.SIGUSR2)
        state = site.config.parent / "state"
        found = [read_history(state, name(0, unit)) for unit in range(1, UNITS + 1)]
        starts.append(sum(row.kind == "start" for rows in found for row in rows))
