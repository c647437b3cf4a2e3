"""What is too many commands, and how often that is published."""

from __future__ import annotations

import asyncio

import pytest

from gateway.system.rate_limits import REFUSAL_EVERY_S, Bucket, Damped, Rate
from tests.virtual_time import VirtualClock, virtually


def test_a_bucket_gives_its_burst_then_its_rate_and_never_holds_more_than_its_burst() -> None:
    bucket = Bucket(Rate(2.0, 3))

    taken = [bucket.take(now_s) for now_s in (0.0, 0.0, 0.0, 0.0, 0.5, 0.5, 1e6, 1e6, 1e6, 1e6)]

    assert taken == [True, True, True, False, True, False, True, True, True, False]


FLOOD = [(0.0, "a", 1), (0.09, "a", 2), (0.1, "a", 3), (0.15, "a", 4)]  # until their number is published
AGAIN = [(0.25, "a", 5), (0.26, "a", 6), (0.5, "a", 7)]
APART = [(0.0, "a", 1), (0.1001, "a", 2), (0.25, "a", 3), (0.25, "b", 4)]


@pytest.mark.parametrize(
    ("puts", "passed_on"),
    [
        (FLOOD + AGAIN, [(0.0, 1, 0), (0.19, 4, 3), (0.35, 6, 2), (0.5, 7, 0)]),
        (APART, [(0.0, 1, 0), (0.1, 2, 0), (0.25, 3, 0), (0.25, 4, 0)]),
    ],
)
@virtually
async def test_a_refusal_is_published_at_once_and_those_soon_after_it_are_counted(
    puts: list[tuple[float, str, int]], passed_on: list[tuple[float, int, int]]
) -> None:
    """An item of a key is put at its time; it is passed on when, and as the last of how many."""
    loop, passed = asyncio.get_running_loop(), list[tuple[float, int, int]]()
    begin_s = loop.time()

    def note(item: int, count: int) -> None:
        passed.append((round(loop.time() - begin_s, 3), item, count))

    refusals = Damped(note, clock=VirtualClock(loop), every_s=REFUSAL_EVERY_S)
    for at_s, key, item in puts:
        await asyncio.sleep(begin_s + at_s - loop.time())
        refusals.put(key, item)
    await asyncio.sleep(1.0)

    assert passed == passed_on
