"""A stop goes before everything else and cuts what is under way."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from gateway.line.rtu.outcome import Outcome
from gateway.line.scheduler.requests import Priority
from gateway.modbus.reads import ReadHoldingRegisters
from gateway.modbus.writes import WriteCoil
from gateway.records import Phase, ResultRecord
from gateway.starters.policy.request import CommandRequest
from tests.starters.fakes import READY, TRANSACTION_S, VB01
from tests.starters.rig import CommandRig, virtually
from tests.starters.rules import ACCEPTED, CONFIRMED, WRITTEN, ignore, running


@virtually
async def test_a_start_waiting_for_the_line_is_withdrawn_by_a_stop() -> None:
    rig = CommandRig()
    await rig.online()
    rig.submit("start", "1")
    await asyncio.sleep(0.019)
    occupied = asyncio.create_task(occupy(rig))  # next on the line, before the start's write

    await asyncio.sleep(0.01)
    rig.submit("stop", "2")
    await asyncio.sleep(5.0)
    await occupied

    assert rig.starts() == 0
    assert rig.sink.final("1").code == "stopped_first"
    assert rig.sink.final("2").phase is Phase.CONFIRMED


@pytest.mark.parametrize("start_age_s", [0.001 * step for step in range(0, 120, 14)])
@virtually
async def test_no_start_ever_goes_out_after_the_stop_that_overtook_it(start_age_s: float) -> None:
    rig = CommandRig()
    await rig.online()
    rig.submit("start", "1")
    await asyncio.sleep(start_age_s)

    rig.submit("stop", "2")
    await asyncio.sleep(5.0)

    first_stop_s = rig.stops()[0].at_s
    late = [
        sent for sent in rig.line.sent if sent.request == WriteCoil(100, True) and sent.at_s > first_stop_s
    ]
    assert late == []
    assert rig.sink.final("1").code == "stopped_first"
    assert rig.unit.holding[VB01] == READY


@virtually
async def test_closing_ends_a_stop_under_way_without_writing_again() -> None:
    rig = await running()
    rig.unit.on_write = ignore
    rig.submit("stop", "1")
    await asyncio.sleep(0.3)
    written = len(rig.line.writes)

    await rig.dispatcher.close()
    await asyncio.sleep(5.0)

    assert rig.sink.final("1").phase is Phase.UNCONFIRMED
    assert rig.sink.final("1").code == "shutting_down"
    assert len(rig.line.writes) == written


@virtually
async def test_closing_during_a_stops_first_write_leaves_it_unconfirmed() -> None:
    rig = await running()
    rig.submit("stop", "1")
    await asyncio.sleep(0.01)

    await rig.dispatcher.close()

    assert rig.sink.final("1").phase is Phase.UNCONFIRMED


async def occupy(rig: CommandRig) -> None:
    request = ReadHoldingRegisters(VB01, 1)
    await rig.line.transact(7, request, response_time_s=0.1, lane=Priority.COMMAND)


@virtually
async def test_a_stop_is_at_the_line_before_anything_is_published_of_it() -> None:
    rig = CommandRig()
    await rig.online()
    published: list[int] = []
    transact = rig.line.transact

    def watched(*args: Any, **options: Any) -> asyncio.Future[Outcome]:
        if options["lane"] is Priority.STOP:
            published.append(len(rig.sink.of(ResultRecord)))
        return transact(*args, **options)

    rig.line.transact = watched  # type: ignore[method-assign]  # looks on, and does the same
    rig.submit("stop", "1")

    assert published == [0]
    assert rig.sink.phases("1") == [ACCEPTED]
    await asyncio.sleep(5.0)
    assert rig.sink.phases("1") == [ACCEPTED, WRITTEN, CONFIRMED]
    assert published == [0]  # it was acknowledged, and so written once


@pytest.mark.parametrize("verb", ["start", "reset", "read"])
@virtually
async def test_a_command_that_came_before_a_stop_and_is_parsed_after_its_end_is_not_carried_out(
    verb: str,
) -> None:
    rig = await running()
    came_s = rig.clock.now_s()
    await asyncio.sleep(0.01)
    rig.submit("stop", "2")
    await asyncio.sleep(5.0)
    assert rig.sink.final("2").phase is Phase.CONFIRMED
    before = len(rig.line.sent)

    args = {"parameter": "P003"} if verb == "read" else {}
    rig.dispatcher.submit(CommandRequest("pump-1", "alice", verb, "1", args, received_s=came_s))
    await asyncio.sleep(5.0)

    assert rig.sink.phases("1") == [("rejected", "stopped_first")]
    assert len(rig.line.sent) == before


@virtually
async def test_of_a_flood_of_stops_each_has_a_frame_that_left_within_a_tenth_of_a_second() -> None:
    rig = await running()
    rig.unit.on_write = ignore
    asked_s = []
    for number in range(300):
        asked_s.append(rig.clock.now_s())
        rig.submit("stop", str(number), client="alice" if number % 2 else "victor")
        await asyncio.sleep(0.005)
    await asyncio.sleep(1.0)

    frames_s = [sent.at_s for sent in rig.stops()]
    assert all(any(0 <= at_s - each <= 0.1 + 2 * TRANSACTION_S for at_s in frames_s) for each in asked_s)
    assert len(frames_s) <= 8 + 10 * 3 + 10
