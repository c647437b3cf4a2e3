"""What is too many commands, and how often that is published."""

from __future__ import annotations

import asyncio

from gateway.system.rate_limits import REFUSAL_EVERY_S, Bucket, Damped, Rate
from tests.virtual_time import VirtualClock, virtually


def test_a_bucket_gives_its_burst_then_its_rate_and_never_holds_more_than_its_burst() -> None:
    bucket = Bucket(Rate(2.0, 3))

    taken = [bucket.take(now_s) for now_s in (0.0, 0.0, 0.0, 0.0, 0.5, 0.5, 1e6, 1e6, 1e6, 1e6)]

    assert taken == [True, True, True, False, True, False, True, True, True, False]


async def damped(*puts: tuple[float, str, int]) -> list[tuple[float, int, int]]:
    """Put items of keys at their times; return when each was passed on, and as the last of how many."""
    loop = asyncio.get_running_loop()
    begin_s, passed = loop.time(), list[tuple[float, int, int]]()

    def note(item: int, count: int) -> None:
        passed.append((round(loop.time() - begin_s, 3), item, count))

    refusals = Damped(note, clock=VirtualClock(loop), every_s=REFUSAL_EVERY_S)
    for at_s, key, item in puts:
        await asyncio.sleep(begin_s + at_s - loop.time())
        refusals.put(key, item)
    await asyncio.sleep(1.0)
    return passed


@virtually
async def test_a_refusal_is_published_at_once_and_those_after_it_are_counted() -> None:
    flood = [(0.0, "a", 1), (0.09, "a", 2), (0.1, "a", 3), (0.15, "a", 4)]  # until their number is published
    again = [(0.25, "a", 5), (0.26, "a", 6), (0.5, "a", 7)]

    assert await damped(*flood, *again) == [(0.0, 1, 0), (0.19, 4, 3), (0.35, 6, 2), (0.5, 7, 0)]


@virtually
async def test_refusals_far_apart_are_all_published() -> None:
    apart = [(0.0, "a", 1), (0.1001, "a", 2), (0.25, "a", 3), (0.25, "b", 4)]

    assert [(item, count) for _, item, count in await damped(*apart)] == [(1, 0), (2, 0), (3, 0), (4, 0)]
