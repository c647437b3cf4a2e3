"""Stops on large lines, in the first second and later: every message has its frame within the bound."""

from __future__ import annotations

import asyncio
import itertools

import pytest

from gateway.records import Phase
from tests.starters.large_line import ALL, LargeLine, large_line, longest_gap_s
from tests.starters.rig import virtually

WHOLE = 247
CONFIRMED_WITHIN_S = 1.0


def check_confirmation(here: LargeLine, id_: str, asked_s: float, address: int = 1) -> None:
    """A stop has its frame within the bound, and is confirmed by two readings after that frame only."""
    frame_s = next(at_s for at_s in here.frames(address) if at_s >= asked_s)
    assert frame_s - asked_s <= here.bound_s
    ended_s, final = here.end(id_, address)
    assert final.phase is Phase.CONFIRMED
    assert len([at_s for at_s in here.readings(address) if frame_s < at_s <= ended_s]) >= 2


@pytest.mark.parametrize("every_s", [0.0])
@pytest.mark.parametrize("after_s", [0.05])
@virtually
async def test_a_stop_in_the_first_second_goes_on_while_the_motor_turns_and_is_confirmed_once_it_stops(
    every_s: float, after_s: float
) -> None:
    async with large_line(WHOLE, every_s=every_s) as here:
        here.unit(1).motor.start()
        here.ignoring.add(1)
        await asyncio.sleep(after_s)
        asked_s = here.clock.now_s()
        here.submit("stop", "1")
        await asyncio.sleep(9.0)
        frames_s = here.frames(1)
        assert frames_s[0] - asked_s <= here.bound_s
        assert len(frames_s) >= 15
        assert max(b - a for a, b in itertools.pairwise(frames_s)) <= 0.5 + here.bound_s

        here.ignoring.clear()
        here.run_locally(1)
        await asyncio.sleep(2.0)

        ended_s, final = here.end("1")
        obeyed_s = next(at_s for at_s in here.frames(1) if at_s >= asked_s + 9.0)
        assert final.phase is Phase.CONFIRMED
        assert ended_s - obeyed_s <= CONFIRMED_WITHIN_S


@pytest.mark.long
@virtually
async def test_two_hundred_second_stops_amid_local_starts_are_never_confirmed_by_what_was_read_before() -> (
    None
):
    async with large_line(2, every_s=2.0) as here:
        await asyncio.sleep(2.0)
        for number in range(200):
            here.submit("stop", f"first {number}")
            await asyncio.sleep(0.02 + 0.29 * number / 200)
            here.run_locally(1)
            await asyncio.sleep(0.005 * (number % 7))
            asked_s = here.clock.now_s()
            here.submit("stop", f"second {number}")
            await asyncio.sleep(1.2)

            check_confirmation(here, f"second {number}", asked_s)
            assert not here.unit(1).motor.is_turned_on


@virtually
async def test_a_stop_that_joins_one_that_is_just_read_back_is_confirmed_by_its_own_readings() -> None:
    async with large_line(4) as here:
        await asyncio.sleep(2.0)
        here.submit("stop", "1")
        while not here.is_read_after_frame(1):  # noqa: ASYNC110 - in virtual time
            await asyncio.sleep(0.0005)
        asked_s = here.clock.now_s()
        here.submit("stop", "2")
        await asyncio.sleep(1.0)

        assert here.end("1")[0] < here.end("2")[0]
        check_confirmation(here, "2", asked_s)


@pytest.mark.parametrize("dead", [6])
@virtually
async def test_stops_of_dead_starters_leave_the_others_watchdogs_their_polls(dead: int) -> None:
    watchdog_s = 3.0
    async with large_line(20, watchdog_s=watchdog_s) as here:
        await asyncio.sleep(5.0)
        for address in range(1, dead + 1):
            here.bus.remove(here.unit(address))
            here.submit("stop", f"{address}", address)
        await asyncio.sleep(12.0)

        until_s = here.clock.now_s()
        for address in range(dead + 1, 21):
            assert longest_gap_s(here.asked_s[address], until_s) < watchdog_s
        assert here.phase("1") is Phase.UNCONFIRMED
        frames = [each for each in here.bus.transcript if each.data[:2] == b"\x01\x05"]
        assert len(frames) >= 10


@virtually
async def test_a_group_that_is_stopped_again_and_again_is_confirmed_as_if_it_had_been_stopped_once() -> None:
    async with large_line(60) as here:
        await asyncio.sleep(8.0)
        for address in range(1, 61):
            here.unit(address).motor.start()
        asked = {}
        for number in range(4):
            asked[number] = here.clock.now_s()
            here.submit("stop", str(number), ALL)
            await asyncio.sleep(0.5)
        await asyncio.sleep(20.0)

        assert {number: here.phase(str(number), ALL) for number in range(4)} == dict.fromkeys(
            range(4), Phase.CONFIRMED
        )
        for address in range(1, 61):
            frames_s = here.frames(address)
            assert all(any(at_s > asked_s for at_s in frames_s) for asked_s in asked.values())
