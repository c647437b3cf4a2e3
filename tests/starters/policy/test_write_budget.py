"""The non-volatile memory of a starter is not worn out, however often a program sets something."""

from __future__ import annotations

import asyncio
from contextlib import nullcontext
from types import SimpleNamespace
from typing import Any

import pytest

from gateway.app.record_log import log_failure
from gateway.contract import CommandError, RecordWriter
from gateway.starters.policy.write_budget import HOUR_S, MOST_PER_HOUR, WriteBudget
from gateway.store import Documents
from tests.virtual_time import VirtualClock, virtually

THIRD = MOST_PER_HOUR // 3
ASKED = [  # what was written when, what is asked for when, the end of a refusal
    ([], (THIRD, 0.0), ""),
    ([(THIRD, 0.0), (THIRD, 600.0), (THIRD, 1200.0)], (1, 1800.0), "try again in 30 min"),
    ([(THIRD, 0.0), (THIRD, 600.0), (THIRD, 1200.0)], (1, HOUR_S), ""),  # the first do not count any more
    ([(THIRD, 0.0), (THIRD, 100.0)], (2 * THIRD, 200.0), "try again in 57 min"),  # there must be room for all
    ([], (MOST_PER_HOUR + 1, 0.0), "this command has more"),
    ([(MOST_PER_HOUR, 0.0)], (0, 0.0), ""),  # what writes nothing that is stored is never refused
]


@pytest.mark.parametrize(("written", "asked", "refusal"), ASKED)
@virtually
async def test_so_many_writes_an_hour_wear_no_memory_out_and_each_count_is_an_event(
    written: list[tuple[int, float]], asked: tuple[int, float], refusal: str
) -> None:
    events: list[Any] = []
    records = RecordWriter(VirtualClock(asyncio.get_running_loop()), log_failure)
    records.connect(SimpleNamespace(put=events.append))
    wear = WriteBudget(records, Documents())
    for writes, now_s in written:
        wear.take("pump", writes, now_s=now_s)

    with pytest.raises(CommandError, match=refusal) if refusal else nullcontext():
        wear.take("pump", asked[0], now_s=asked[1])

    wear.take("fan", MOST_PER_HOUR, now_s=asked[1])  # each starter has its own count
    taken = [*written, (0, 0.0) if refusal else asked]
    totals = {event.starter: event.data["total"] for event in events}
    assert totals.pop("fan") == events[-1].data["last_hour"] == MOST_PER_HOUR
    assert totals.get("pump", 0) == sum(writes for writes, _ in taken)
