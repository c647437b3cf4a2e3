from __future__ import annotations

import asyncio
import itertools
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import pytest

from gateway.line.rtu.outcome import Answered, Silent
from gateway.line.scheduler.requests import Slot
from gateway.line.statistics import Statistics
from tests.line.fakes import DELAY_S, RESPONSE_TIME_S, TIMING, LineRig, Said, Units, poll
from tests.line.served import run_for
from tests.virtual_time import run_virtually


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


def test_a_line_that_has_just_opened_has_spent_nothing() -> None:
    assert set(Statistics().time_share(5.0).values()) == {0.0}


def test_a_served_line_shows_how_it_spends_its_time() -> None:
    rig = LineRig(Units({1}), [poll("a", 1, 0.1)])
    found: dict[str, Any] = {}

    async def scenario() -> None:
        async with rig:
            await asyncio.sleep(60.0)
            found.update(rig.client.statistics())

    run_virtually(scenario())
    per_s = 10
    assert found["time_share"] == pytest.approx(
        {
            "requests": per_s * TIMING.wire_s(8),
            "delays": per_s * DELAY_S,
            "replies": per_s * TIMING.wire_s(25),
            "silences": found["utilisation"] - per_s * (TIMING.wire_s(33) + DELAY_S),
        },
        rel=0.05,
        abs=0.001,
    )


def test_corrupted_and_late_replies_of_a_unit_are_counted() -> None:
    good = Units({1, 2})
    counts = {unit: itertools.count() for unit in (1, 2)}

    def answer(frame: bytes) -> Iterable[Said]:
        number = next(counts[frame[0]])
        for said in good(frame):
            if frame[0] == 1 and number % 5 == 0:
                yield replace(said, data=said.data[:-1] + bytes((said.data[-1] ^ 1,)))
            elif frame[0] == 2 and number % 5 == 4:
                yield replace(said, delay_s=RESPONSE_TIME_S + 0.2)
            else:
                yield said

    rig = run_for(60.0, answer, [poll("a", 1, 0.5), poll("b", 2, 0.5)])

    units = rig.client.statistics()["units"]
    assert units[1]["corrupted"] == units[1]["garbled"] > 5
    assert units[2]["late"] == units[2]["silent"] > 5
    assert units[1]["late"] == units[2]["corrupted"] == 0
