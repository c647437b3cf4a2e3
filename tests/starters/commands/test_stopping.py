"""A stop needs nothing, overtakes everything and is repeated."""

from __future__ import annotations

import asyncio
import logging

import pytest

from gateway.line.rtu.outcome import Garbled, Silent
from gateway.line.scheduler.requests import Priority
from gateway.modbus.writes import WriteCoil
from gateway.records import Phase, ResultRecord
from gateway.starters.commands import starter_io as wire
from tests.starters.fakes import READY, VB01
from tests.starters.rig import virtually
from tests.starters.rules import ACCEPTED, CONFIRMED, WRITTEN, broken, ignore, running


@virtually
async def test_a_stop_is_written_at_once_without_reading_anything_first() -> None:
    rig = await running()

    rig.submit("stop", None)
    await asyncio.sleep(5.0)

    assert rig.line.sent[0].request == WriteCoil(100, False)
    assert rig.line.sent[0].lane is Priority.STOP
    assert rig.sink.phases() == [ACCEPTED, WRITTEN, CONFIRMED]


@virtually
async def test_a_stop_is_confirmed_only_by_two_readings() -> None:
    rig = await running()

    rig.submit("stop", None)
    await rig.poll_for(5.0)

    assert [sent.request.is_write for sent in rig.line.sent] == [True, False, False]


@virtually
async def test_a_stop_that_is_never_acknowledged_goes_on_although_the_motor_seems_to_stand() -> None:
    rig = await running()
    rig.unit.holding[VB01] = READY

    with rig.line.silence(WriteCoil):
        rig.submit("stop", None)
        await asyncio.sleep(5.0)
        assert rig.sink.phases() == [ACCEPTED, WRITTEN]
        await asyncio.sleep(10.0)

    assert len(rig.stops()) > 15
    assert rig.sink.final().phase is Phase.CONFIRMED


@virtually
async def test_readings_from_before_the_acknowledgement_do_not_confirm_a_stop() -> None:
    rig = await running()
    rig.unit.holding[VB01] = READY
    rig.line.rules.append(lambda r: Silent() if r.is_write and len(rig.line.writes) < 3 else None)

    rig.submit("stop", None)
    await asyncio.sleep(5.0)

    last_write = max(index for index, sent in enumerate(rig.line.sent) if sent.request.is_write)
    assert len(rig.line.sent) - last_write - 1 >= 2
    assert rig.sink.final().phase is Phase.CONFIRMED


@virtually
async def test_the_result_of_a_stop_of_which_only_noise_came_back_says_so() -> None:
    rig = await running()
    rig.line.rules.append(lambda _: Garbled("bad CRC", b"\x55"))

    rig.submit("stop", "1")
    await asyncio.sleep(12.0)

    assert rig.sink.phases("1") == [ACCEPTED, WRITTEN, ("unconfirmed", "no_answer")]
    assert "what came instead cannot be read" in rig.sink.final("1").text


@virtually
async def test_a_joining_stop_gets_its_full_time() -> None:
    rig = await running()
    rig.unit.on_write = ignore
    rig.submit("stop", "1")
    await asyncio.sleep(9.0)

    rig.submit("stop", "2")
    await asyncio.sleep(5.0)

    assert rig.sink.phases("2") == [ACCEPTED, WRITTEN]
    await asyncio.sleep(10.0)
    assert rig.sink.final("2").phase is Phase.UNCONFIRMED


@virtually
async def test_a_repetition_of_a_stop_under_way_gets_its_present_phase() -> None:
    rig = await running()
    rig.submit("stop", "1")
    await asyncio.sleep(0.05)

    rig.submit("stop", "1")

    assert [(r.phase.value, r.is_duplicate) for r in rig.sink.of(ResultRecord)][-1] == ("written", True)


@virtually
async def test_a_stop_with_an_id_that_was_used_for_something_else_still_stops() -> None:
    rig = await running()
    rig.submit("read", "1", args={"parameter": "P003"})
    await asyncio.sleep(1.0)
    rig.sink.clear()

    rig.submit("stop", "1")
    await asyncio.sleep(5.0)

    assert rig.sink.phases() == [ACCEPTED, WRITTEN, CONFIRMED]
    assert not rig.sink.final().is_duplicate


@virtually
async def test_an_error_inside_a_stop_is_reported_and_calls_a_person(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    rig = await running()
    monkeypatch.setattr(wire, "rows_in", broken)

    with caplog.at_level(logging.ERROR):
        rig.submit("stop", "1")
        await asyncio.sleep(5.0)

    assert rig.sink.phases() == [ACCEPTED, WRITTEN, ("unconfirmed", "internal")]
    assert "stop_unconfirmed" in rig.sink.events()
    assert len(rig.stops()) == 1


@virtually
async def test_of_stops_too_many_to_follow_up_none_is_said_to_be_rejected_for_each_is_sent() -> None:
    rig = await running()

    for number in range(30):
        rig.submit("stop", f"{number}")
    await asyncio.sleep(5.0)

    ends = [each for each in rig.sink.of(ResultRecord) if each.phase.is_final]
    assert {(each.phase, each.code) for each in ends} == {
        (Phase.CONFIRMED, "ok"),
        (Phase.UNCONFIRMED, "too_many"),
    }
    assert sum(each.values.get("count", 1) for each in ends) == 30
