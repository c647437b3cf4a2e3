from __future__ import annotations

from itertools import pairwise
from typing import Any

import pytest

from gateway.line.rtu.outcome import Answered, Silent
from gateway.line.scheduler.requests import Slot
from gateway.line.statistics import Statistics
from tests.line.fakes import poll

MANY = 247


def answer(statistics: Statistics, unit: int, response_time_s: float, *, now_s: float = 0.0) -> None:
    asked = poll(f"u{unit}", unit=unit)
    slot = Slot(unit, asked.request, 0.02, now_s, poll=asked)
    statistics.note(slot, Answered((1,), now_s, response_time_s), took_s=0.01, now_s=now_s)


def units(statistics: Statistics, now_s: float) -> dict[int, dict[str, Any]]:
    payload = statistics.to_dict((), worst_stop_latency_s=0.1, now_s=now_s)
    return dict(payload["units"])


def test_of_many_units_only_some_are_computed_at_a_time_and_none_is_left_out() -> None:
    statistics = Statistics()
    statistics.begin(0.0)
    for unit in range(1, MANY + 1):
        answer(statistics, unit, 0.005)

    known = [
        sum(each["response_time_s"]["p50"] is not None for each in units(statistics, float(second)).values())
        for second in range(40)
    ]

    assert all(later - before <= 8 for before, later in pairwise(known))
    assert known[-1] == MANY


def test_shares_are_of_the_last_half_minute_and_the_silences_are_what_is_left_of_the_busy_time() -> None:
    statistics = Statistics()
    statistics.begin(0.0)
    asked = poll("status", unit=1)
    for second in range(1, 11):
        slot = Slot(1, asked.request, 0.02, float(second), poll=asked)
        statistics.note(
            slot,
            Answered((1,), second, 0.05),
            took_s=0.2,
            now_s=float(second),
            request_s=0.03,
            since_request_s=0.13,
            reply_s=0.08,
        )

    share = statistics.time_share(10.0)

    assert share == pytest.approx({"requests": 0.03, "delays": 0.05, "replies": 0.08, "silences": 0.04})
    assert sum(share.values()) == pytest.approx(statistics.utilisation(10.0))


def test_a_request_that_was_not_sent_is_silence() -> None:
    statistics = Statistics()
    statistics.begin(0.0)
    asked = poll("status", unit=1)
    slot = Slot(1, asked.request, 0.02, 1.0, poll=asked)
    statistics.note(slot, Silent("too late", is_sent=False), took_s=0.5, now_s=1.0)

    assert statistics.time_share(1.0) == {"requests": 0, "delays": 0, "replies": 0, "silences": 0.5}
