from __future__ import annotations

import asyncio
from dataclasses import replace

import pytest

from gateway.families.profile.load import load_profile
from gateway.line.rtu.outcome import Outcome, Refused, Silent
from gateway.modbus.pdu import Request
from gateway.modbus.reads import ReadHoldingRegisters
from gateway.records import Quality
from gateway.starters.telemetry.polling import IDLE_FACTOR, IN_ROW, LONGEST_PAUSE_S
from gateway.starters.telemetry.telemetry import StarterTelemetry
from tests.starters.fakes import ACCELERATING, AT_SPEED, FAULT, P003, READY, RUNNING, VB01
from tests.starters.rig import Rig, virtually

STATUS, VALUES = "pump-1/status:VB01", "pump-1/values:P002"
STALE = Quality.STALE


@virtually
async def test_status_is_read_first_and_slow_rows_ten_times_less_often() -> None:
    rig = Rig(every_s=2.0)

    periods_s = [(poll.key.split("/")[1].split(":")[0], poll.every_s) for poll in rig.telemetry.polls()]

    assert periods_s[0] == ("status", 2.0)
    assert {every_s for group, every_s in periods_s if group == "slow"} == {20.0}
    assert {every_s for group, every_s in periods_s if group != "slow"} == {2.0}


@virtually
async def test_slow_rows_are_never_read_more_often_than_every_ten_seconds() -> None:
    rig = Rig(every_s=0.0)

    assert {poll.every_s for poll in rig.telemetry.polls()} == {0.0, 10.0}


@virtually
async def test_status_and_values_are_read_faster_while_the_motor_starts() -> None:
    rig = await Rig().online()
    rig.unit.holding[VB01] = READY | RUNNING | ACCELERATING

    rig.poll(STATUS)

    assert rig.line.every_s[STATUS] == 0.25
    assert rig.line.every_s[VALUES] == 0.25
    assert {every_s for key, every_s in rig.line.every_s.items() if "slow" in key} == {10.0}


@virtually
async def test_the_values_are_read_at_once_when_the_motor_begins_to_start_and_not_again_after_that() -> None:
    rig = await Rig().online()
    rig.line.expedited.clear()
    rig.unit.holding[VB01] = READY | RUNNING | ACCELERATING

    rig.poll(STATUS)
    assert VALUES in rig.line.expedited  # a quarter of a second later the current has risen already

    rig.line.expedited.clear()
    rig.poll(STATUS)
    assert VALUES not in rig.line.expedited


@virtually
async def test_the_usual_period_returns_when_the_motor_is_at_speed() -> None:
    rig = await Rig().online()
    for word in (READY | RUNNING | ACCELERATING, AT_SPEED):
        rig.unit.holding[VB01] = word
        rig.poll(STATUS)

    assert rig.line.every_s[STATUS] == 1.0


@virtually
async def test_a_starter_that_is_read_faster_anyway_stays_as_it_is() -> None:
    rig = await Rig(every_s=0.0).online()
    rig.unit.holding[VB01] = READY | FAULT

    rig.poll(STATUS)

    assert rig.line.every_s[STATUS] == 0.0


@virtually
async def test_a_refused_block_is_asked_row_by_row() -> None:
    rig = await Rig().online()
    rig.line.rules.append(refuse_p003)

    rig.poll(VALUES)
    rig.poll(VALUES)
    assert VALUES in rig.line.polls  # so often it may be by chance
    rig.poll(VALUES)

    values = {key for key in rig.line.polls if "/values:" in key}
    assert {"pump-1/values:P002 alone", "pump-1/values:P003 alone"} <= values
    assert all(rig.line.every_s[key] == IDLE_FACTOR * 1.0 for key in values)  # the motor stands


@virtually
async def test_values_are_read_less_often_while_the_motor_stands_and_the_status_is_not() -> None:
    rig = await Rig().online()
    assert (rig.line.every_s[VALUES], rig.line.every_s[STATUS]) == (3.0, 1.0)

    rig.unit.holding[VB01] = AT_SPEED
    rig.poll(STATUS)

    assert (rig.line.every_s[VALUES], rig.line.every_s[STATUS]) == (1.0, 1.0)


@virtually
async def test_a_row_given_up_is_asked_again_after_a_silence() -> None:
    rig = await Rig().online()
    rig.line.rules.append(refuse_p003)
    await rig.poll_for(30.0)
    rig.line.rules.clear()

    rig.lose()
    rig.poll()
    rig.poll()
    await asyncio.sleep(1.0)

    assert rig.sink.values("current")[-1].quality is Quality.GOOD
    assert set(rig.line.polls) == {poll.key for poll in rig.telemetry.polls()}


@virtually
async def test_a_starter_that_refuses_everything_is_still_asked_for_what_decides() -> None:
    rig = await Rig().online()
    rig.line.rules.append(lambda request: Refused(2, at_s=rig.clock.now_s()))

    await rig.poll_for(60.0)

    rows = {code for poll in rig.line.polls.values() for code in read_codes(poll.request)}
    assert VB01 in rows
    assert P003 not in rows
    assert max(rig.line.every_s.values()) == LONGEST_PAUSE_S
    assert rig.telemetry.is_answering


@virtually
async def test_what_is_polled_fast_stays_fast_when_its_block_is_split() -> None:
    rig = await Rig().online()
    rig.unit.holding[VB01] = READY | FAULT
    rig.poll(STATUS)
    rig.line.rules.append(refuse_p003)

    for _ in range(IN_ROW):
        rig.poll(VALUES)

    assert rig.line.every_s["pump-1/values:P003 alone"] == 0.25


@virtually
async def test_an_answer_to_a_poll_that_was_removed_is_ignored() -> None:
    rig = await Rig().online()

    rig.telemetry.on_poll("pump-1/values:gone", Silent())

    assert rig.sink.records == []


@virtually
async def test_what_the_identified_variant_lacks_is_not_asked_any_more() -> None:
    profile = load_profile("ssw07")
    recent = {"current": profile.points["current"].model_copy(update={"since_firmware": "9.00"})}
    rig = Rig()
    rig.setup = replace(rig.setup, profile=profile.model_copy(update={"points": profile.points | recent}))
    rig.telemetry = StarterTelemetry(rig.setup, line=rig.line, records=rig.records)

    await rig.online()

    rows = {code for poll in rig.line.polls.values() for code in read_codes(poll.request)}
    assert P003 not in rows
    assert VB01 in rows


@pytest.mark.parametrize("code", [1, 2, 3, 4])
@virtually
async def test_one_exception_to_the_status_word_changes_nothing(code: int) -> None:
    rig = await Rig().online()
    rig.line.rules.append(lambda _: Refused(code, at_s=rig.clock.now_s()))
    rig.poll(STATUS)
    rig.line.rules.clear()

    assert STATUS in rig.line.expedited
    rig.unit.holding[VB01] = READY | FAULT
    rig.poll(STATUS)
    rig.poll(STATUS)

    assert rig.sink.states() == ["fault"]
    assert [event for event in rig.sink.events() if event in ("degraded", "recovered")] == []


def read_codes(request: Request) -> range:
    assert isinstance(request, ReadHoldingRegisters)
    return range(request.address, request.address + request.count)


def refuse_p003(request: Request) -> Outcome | None:
    is_hit = isinstance(request, ReadHoldingRegisters) and P003 in range(
        request.address, request.address + request.count
    )
    return Refused(2, at_s=asyncio.get_running_loop().time()) if is_hit else None
