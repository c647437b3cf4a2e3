"""Commands of one line are served a few at a time; those that would be too late are refused."""

from __future__ import annotations

import asyncio
from collections import Counter

import pytest

from gateway.errors import CommandError
from gateway.records import Phase
from gateway.starters.commands.command_queue import AT_ONCE, LINE_FULL, CommandQueue, Place
from gateway.starters.policy.start_rules import PolicySettings, RateLimits
from gateway.system.rate_limits import Rate
from tests.starters.large_line import START_PDU, large_line
from tests.starters.rig import virtually

TTL_S = 5.0
MANY = PolicySettings(limits=RateLimits(client=Rate(1000.0, 1000), everyone=Rate(1000.0, 1000)))


def a_queue() -> CommandQueue:
    return CommandQueue(asyncio.get_running_loop().time)


async def serve(place: Place, seconds: float) -> str:
    """Wait for a slot, hold it for so long, and leave; return how that ended."""
    try:
        await place.wait()
        await asyncio.sleep(seconds)
    except CommandError as error:
        return error.code
    finally:
        place.leave()
    return "ok"


@virtually
async def test_a_few_are_served_at_once_and_the_others_one_after_the_other() -> None:
    queue, loop = a_queue(), asyncio.get_running_loop()
    done_s: list[float] = []
    for _ in range(3 * AT_ONCE):
        task = asyncio.ensure_future(serve(queue.enter(None), 1.0))
        task.add_done_callback(lambda _: done_s.append(loop.time()))
    await asyncio.sleep(10.0)

    assert done_s == pytest.approx([1.0] * AT_ONCE + [2.0] * AT_ONCE + [3.0] * AT_ONCE)


@virtually
async def test_those_that_would_be_served_too_late_are_refused_as_soon_as_that_is_known() -> None:
    queue, loop = a_queue(), asyncio.get_running_loop()
    ends: list[tuple[float, str]] = []
    for _ in range(20 * AT_ONCE):
        task = asyncio.ensure_future(serve(queue.enter(TTL_S), 1.0))
        task.add_done_callback(lambda each: ends.append((loop.time(), each.result())))
    await asyncio.sleep(30.0)

    assert Counter(end for _, end in ends)[LINE_FULL] >= 15 * AT_ONCE
    assert Counter(end for _, end in ends)["ok"] >= 3 * AT_ONCE
    assert max(at_s for at_s, end in ends if end == LINE_FULL) <= 1.1
    assert max(at_s for at_s, _ in ends) <= TTL_S + 0.01


@virtually
async def test_a_wait_that_cannot_be_foreseen_ends_when_the_command_expires() -> None:
    queue = a_queue()
    for _ in range(AT_ONCE):
        asyncio.ensure_future(serve(queue.enter(None), 60.0))  # noqa: RUF006
    await asyncio.sleep(0.1)

    assert await serve(queue.enter(0.1 + TTL_S), 1.0) == LINE_FULL
    assert asyncio.get_running_loop().time() == pytest.approx(0.1 + TTL_S)


@virtually
async def test_a_rush_that_is_over_keeps_no_later_command_out() -> None:
    queue = a_queue()
    for _ in range(AT_ONCE):
        asyncio.ensure_future(serve(queue.enter(None), 60.0))  # noqa: RUF006
    await asyncio.sleep(100.0)

    assert queue.wait_s() == 0.0
    assert await serve(queue.enter(100.0 + TTL_S), 0.1) == "ok"


@virtually
async def test_a_place_that_is_given_up_while_it_waits_keeps_no_other_waiting() -> None:
    queue = a_queue()
    for _ in range(AT_ONCE):
        asyncio.ensure_future(serve(queue.enter(None), 1.0))  # noqa: RUF006
    await asyncio.sleep(0.1)
    given_up = asyncio.ensure_future(serve(queue.enter(None), 60.0))
    last = asyncio.ensure_future(serve(queue.enter(None), 1.0))
    await asyncio.sleep(0.1)
    given_up.cancel()
    await asyncio.sleep(2.0)

    assert last.done()


@virtually
async def test_32_starts_at_once_on_an_over_full_line_are_carried_out_in_order_or_refused_with_the_wait() -> (
    None
):
    async with large_line(80, every_s=0.0, baud=9600, settings=MANY) as here:
        await asyncio.sleep(60.0)
        asked_s = here.clock.now_s()
        for address in range(1, 33):
            here.submit("start", f"s{address}", address, expires_s=asked_s + TTL_S)
        await asyncio.sleep(30.0)

        ends = {address: here.end(f"s{address}", address)[1] for address in range(1, 33)}
        codes = Counter(end.code for end in ends.values())
        assert set(codes) <= {"ok", LINE_FULL}
        assert codes["ok"] >= 8
        refused = [end for end in ends.values() if end.code == LINE_FULL]
        assert all(end.phase is Phase.REJECTED and " s" in end.text for end in refused)
        frames_s = {address: here.frames(address, START_PDU) for address in ends}
        assert all(len(frames_s[each]) == (ends[each].code == "ok") for each in ends)
        assert all(
            at_s <= asked_s + TTL_S + here.bound_s for times_s in frames_s.values() for at_s in times_s
        )


@virtually
async def test_when_a_rush_is_under_way_the_next_start_is_refused_at_the_door_with_the_wait() -> None:
    async with large_line(80, every_s=0.0, baud=9600, settings=MANY) as here:
        await asyncio.sleep(60.0)
        asked_s = here.clock.now_s()
        for address in range(1, 32):
            here.submit("start", f"s{address}", address, expires_s=asked_s + 60.0)
        await asyncio.sleep(2.0)
        here.submit("start", "s40", 40, expires_s=here.clock.now_s() + 1.0)

        phases = [(each.phase, each.code) for _, each in here.results("s40", 40)]
        assert phases == [(Phase.REJECTED, LINE_FULL)]
        assert "the command could go out in" in here.end("s40", 40)[1].text
