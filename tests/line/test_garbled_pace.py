"""A unit whose replies are corrupted may receive every request: it is asked often enough for its watchdog."""

from __future__ import annotations

from itertools import pairwise

import pytest

from gateway.line.rtu.outcome import Garbled, Outcome, Silent
from gateway.line.scheduler.scheduler import Scheduler
from tests.line.fakes import poll
from tests.line.scheduled import NoChance

COST_S = 0.05


def asked_s(outcome: Outcome, *, until_s: float) -> list[float]:
    """Return when a unit is asked whose every request ends so."""
    scheduler = Scheduler([poll("a", every_s=1.0)], chance=NoChance())
    scheduler.polls.begin(0.0)
    now_s, times_s = 0.0, []
    while now_s < until_s:
        slot = scheduler.pick(now_s)
        if slot is None:
            now_s = max(scheduler.next_due_s(), now_s + 0.001)
            continue
        times_s.append(now_s)
        now_s += COST_S
        scheduler.record(slot, outcome, now_s)
    return times_s


@pytest.mark.parametrize(("outcome", "longest_s"), [(Garbled("bad CRC", b"\x01\x02"), 1.1), (Silent(), 16.1)])
def test_garbage_keeps_the_pace_and_silence_does_not(outcome: Outcome, longest_s: float) -> None:
    times_s = asked_s(outcome, until_s=200.0)

    longest_found_s = max(later - earlier for earlier, later in pairwise(times_s))
    assert longest_s / 2 < longest_found_s <= longest_s
