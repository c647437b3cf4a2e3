from __future__ import annotations

import asyncio
import logging

import pytest

from gateway.families.load import FAMILIES
from gateway.families.schema import Variant
from gateway.line.outcome import Garbled, Outcome, Refused, Silent
from gateway.modbus.pdu import Request
from gateway.modbus.reads import ReadHoldingRegisters
from gateway.starters.records import (
    AlarmRecord,
    AvailabilityRecord,
    EventRecord,
    InfoRecord,
    Quality,
    StateRecord,
    ValueRecord,
)
from tests.starters.fakes import (
    ACCELERATING,
    AT_SPEED,
    FAULT,
    P003,
    P014,
    READY,
    REMOTE,
    RUNNING,
    VB01,
    Rig,
    virtually,
)

STATUS, VALUES = "pump-1/status:VB01", "pump-1/values:P002"
STALE = Quality.STALE


@virtually
async def test_before_the_first_answer_everything_is_bad_and_the_starter_offline() -> None:
    rig = Rig()

    rig.telemetry.start()

    values = rig.sink.of(ValueRecord)
    assert {value.point for value in values} == set(rig.setup.profile.points)
    assert all((value.value, value.quality, value.time_s) == (None, Quality.BAD, None) for value in values)
    assert [(r.state, r.reason) for r in rig.sink.of(AvailabilityRecord)] == [("offline", "not yet read")]
    (state,) = rig.sink.of(StateRecord)
    assert (state.state, state.quality, state.time_s) == ("unknown", Quality.BAD, None)


@virtually
async def test_a_disabled_starter_is_never_asked() -> None:
    rig = Rig(is_enabled=False)

    rig.telemetry.start()

    assert rig.telemetry.polls() == ()
    assert rig.sink.of(AvailabilityRecord)[0].state == "disabled"


@pytest.mark.parametrize("family", FAMILIES)
@virtually
async def test_one_turn_of_all_polls_tells_the_state(family: str) -> None:
    rig = Rig(family)
    rig.telemetry.start()

    rig.poll()

    assert rig.sink.states()[-1] == "ready"
    assert rig.telemetry.is_answering
    assert rig.sink.of(AvailabilityRecord)[-1].state == "online"


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
async def test_a_value_is_told_with_the_time_its_reply_left_the_wire() -> None:
    rig = await Rig().online()
    rig.unit.holding[P003] = 815
    await asyncio.sleep(1.0)

    rig.poll(VALUES)

    (current,) = rig.sink.values("current")
    assert (current.value, current.unit, current.quality) == (81.5, "A", Quality.GOOD)
    assert current.time_s == rig.clock.utc_s()


@virtually
async def test_a_change_within_the_pause_goes_out_when_the_pause_is_over() -> None:
    rig = await Rig().online()
    rig.unit.holding[P003] = 100
    await asyncio.sleep(1.0)
    rig.poll(VALUES)
    await asyncio.sleep(0.1)
    rig.unit.holding[P003] = 200
    rig.poll(VALUES)
    assert [record.value for record in rig.sink.values("current")] == [10.0]

    await asyncio.sleep(0.16)

    assert [record.value for record in rig.sink.values("current")] == [10.0, 20.0]


@virtually
async def test_the_state_goes_out_at_once_however_often_it_changes() -> None:
    rig = await Rig().online()

    for word in (READY | RUNNING | ACCELERATING, AT_SPEED, READY):
        rig.unit.holding[VB01] = word
        rig.poll(STATUS)

    assert rig.sink.states() == ["starting", "running", "ready"]


@virtually
async def test_an_unchanged_state_is_told_again_within_thirty_seconds() -> None:
    rig = await Rig().online()

    await rig.poll_for(31.0)

    assert rig.sink.states() == ["ready"]
    assert len(rig.sink.values("running")) == 1


@virtually
async def test_a_state_carries_its_boolean_points() -> None:
    rig = await Rig().online()
    rig.unit.holding[VB01] = AT_SPEED

    rig.poll(STATUS)

    (state,) = rig.sink.of(StateRecord)
    assert state.flags["running"] is True
    assert state.flags["fault"] is False
    assert state.flags["remote"] is True
    assert state.quality is Quality.GOOD


@virtually
async def test_a_starter_that_goes_silent_is_offline_and_all_its_values_stale() -> None:
    rig = await Rig().online()
    rig.unit.holding[P003] = 815
    await asyncio.sleep(1.0)
    rig.poll()
    read_s = rig.clock.utc_s()
    await asyncio.sleep(1.0)
    rig.sink.clear()

    rig.lose("no reply", frames=(">> 07 03", "<< nothing"))

    assert [(r.state, r.reason) for r in rig.sink.of(AvailabilityRecord)] == [("offline", "no reply")]
    assert [(v.value, v.quality, v.time_s) for v in rig.sink.values("current")] == [(81.5, STALE, read_s)]
    assert {v.quality for v in rig.sink.of(ValueRecord)} == {STALE}
    (state,) = rig.sink.of(StateRecord)
    assert (state.state, state.quality, state.time_s) == ("unknown", STALE, read_s)
    assert set(state.flags.values()) == {None}
    (event,) = rig.sink.of(EventRecord)
    assert event.code == "went_silent"
    assert event.data["frames"] == [">> 07 03", "<< nothing"]


@virtually
async def test_every_point_that_was_good_is_told_as_stale_even_right_after_a_publication() -> None:
    rig = await Rig().online()
    await asyncio.sleep(1.0)
    rig.unit.holding[P003] = 815
    rig.poll(VALUES)

    rig.lose()
    await asyncio.sleep(0.3)

    assert [record.quality for record in rig.sink.values("current")] == [Quality.GOOD, STALE]


@virtually
async def test_nothing_is_told_as_good_while_a_starter_is_lost() -> None:
    rig = await Rig().online()
    rig.lose()
    rig.sink.clear()

    await asyncio.sleep(100.0)

    assert {record.quality for record in rig.sink.of(ValueRecord)} <= {STALE, Quality.BAD}
    assert {record.quality for record in rig.sink.of(StateRecord)} == {STALE}
    assert len(rig.sink.values("current")) == 3


@virtually
async def test_silence_is_told_once(caplog: pytest.LogCaptureFixture) -> None:
    rig = await Rig().online()

    with caplog.at_level(logging.WARNING, logger="gateway.starters"):
        rig.lose()
        rig.lose()

    assert rig.sink.events() == ["went_silent"]
    assert len(caplog.records) == 1


@virtually
async def test_the_first_answer_after_a_silence_brings_the_starter_back() -> None:
    rig = await Rig().online()
    rig.lose()
    rig.sink.clear()
    await asyncio.sleep(5.0)

    rig.poll()
    await asyncio.sleep(0.3)

    assert [record.state for record in rig.sink.of(AvailabilityRecord)] == ["online"]
    assert rig.sink.events() == ["answers_again"]
    assert rig.sink.states() == ["unknown", "ready"][-len(rig.sink.states()) :]
    assert {value.quality for value in rig.sink.values("running")} == {Quality.GOOD}


@virtually
async def test_being_told_that_a_unit_answers_brings_it_online_once() -> None:
    rig = Rig()
    rig.telemetry.start()

    rig.telemetry.on_unit(is_answering=True, reason="")
    rig.telemetry.on_unit(is_answering=True, reason="")

    assert [record.state for record in rig.sink.of(AvailabilityRecord)] == ["offline", "online"]


@pytest.mark.parametrize("outcome", [Silent(), Garbled("bad CRC", b""), Refused(6, 0.0)])
@virtually
async def test_values_that_are_no_longer_answered_become_stale(outcome: Outcome) -> None:
    rig = await Rig().online()
    await asyncio.sleep(1.0)
    rig.poll()

    for _ in range(5):
        rig.telemetry.on_poll(VALUES, outcome)
        rig.poll(STATUS)
        await asyncio.sleep(1.0)

    assert rig.telemetry.is_answering
    assert rig.sink.values("current")[-1].quality is STALE
    assert rig.telemetry.snapshot.readings["running"].quality is Quality.GOOD
    assert "unknown" not in rig.sink.states()


@virtually
async def test_a_line_that_stops_telling_anything_makes_everything_stale() -> None:
    rig = await Rig().online()
    await asyncio.sleep(1.0)
    rig.poll()

    await asyncio.sleep(120.0)

    assert rig.sink.states()[-1] == "unknown"
    assert {rig.sink.values(point)[-1].quality for point in rig.setup.profile.points} <= {STALE, Quality.BAD}


@virtually
async def test_a_slow_line_does_not_make_its_values_stale() -> None:
    rig = await Rig().online()

    for _ in range(10):
        await asyncio.sleep(3.9)
        rig.poll()

    assert {record.quality for record in rig.sink.values("running")} == {Quality.GOOD}


@virtually
async def test_status_and_values_are_read_faster_while_the_motor_starts() -> None:
    rig = await Rig().online()
    rig.unit.holding[VB01] = READY | RUNNING | ACCELERATING

    rig.poll(STATUS)

    assert rig.line.every_s[STATUS] == 0.25
    assert rig.line.every_s[VALUES] == 0.25
    assert {every_s for key, every_s in rig.line.every_s.items() if "slow" in key} == {10.0}


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
async def test_a_fault_is_told_with_the_values_before_it() -> None:
    rig = await Rig().online()
    rig.unit.holding |= {VB01: AT_SPEED, P003: 815}
    await asyncio.sleep(1.0)
    rig.poll()
    await asyncio.sleep(1.0)
    rig.unit.holding |= {VB01: REMOTE | FAULT, P003: 0, P014: 5}
    rig.sink.clear()

    rig.poll(STATUS)

    assert rig.sink.states() == ["fault"]
    event = rig.sink.of(EventRecord)[-1]
    assert event.code == "fault"
    assert event.data["from"] == "running"
    assert event.data["before"][-1]["values"]["current"] == 81.5
    assert VALUES in rig.line.hastened


@virtually
async def test_a_fault_gets_its_number_only_from_a_reading_after_it() -> None:
    rig = await Rig().online()
    rig.unit.holding[P014] = 3
    rig.poll()
    await asyncio.sleep(1.0)
    rig.unit.holding |= {VB01: READY | FAULT, P014: 5}
    rig.sink.clear()

    rig.poll(STATUS)
    rig.poll()

    alarms = [(alarm.code, alarm.is_active) for alarm in rig.sink.of(AlarmRecord)]
    assert alarms == [("fault", True), ("e05", True), ("fault", False)]
    assert "cleared" not in rig.sink.events()


@virtually
async def test_a_fault_that_is_reset_is_cleared_with_its_time() -> None:
    rig = await Rig().online()
    rig.unit.holding |= {VB01: READY | FAULT, P014: 5}
    rig.poll()
    await asyncio.sleep(2.0)
    rig.unit.holding[VB01] = READY

    rig.poll()

    last = rig.sink.of(AlarmRecord)[-1]
    assert (last.code, last.is_active, last.count) == ("e05", False, 1)
    assert last.cleared_s == rig.clock.utc_s()
    assert rig.sink.events()[-1] == "cleared"


@virtually
async def test_an_alarm_stays_as_it_was_while_the_starter_is_lost() -> None:
    rig = await Rig().online()
    rig.unit.holding |= {VB01: READY | FAULT, P014: 5}
    rig.poll()
    rig.sink.clear()

    rig.lose()
    await asyncio.sleep(60.0)

    assert rig.sink.of(AlarmRecord) == []


@virtually
async def test_a_switch_to_local_operation_is_an_event() -> None:
    rig = await Rig().online()
    rig.unit.holding[VB01] = READY & ~REMOTE

    rig.poll(STATUS)

    assert rig.sink.events() == ["local_operation"]


@virtually
async def test_a_refused_block_is_asked_row_by_row() -> None:
    rig = await Rig().online()
    rig.line.rules.append(refuse_p003)

    rig.poll(VALUES)

    values = {key for key in rig.line.polls if "/values:" in key}
    assert {"pump-1/values:P002", "pump-1/values:P003"} <= values
    assert all(rig.line.every_s[key] == 1.0 for key in values)


@virtually
async def test_only_the_row_that_is_still_refused_is_bad_and_given_up() -> None:
    rig = await Rig().online()
    rig.line.rules.append(refuse_p003)

    rig.poll()
    rig.poll()

    assert "pump-1/values:P003" not in rig.line.polls
    await asyncio.sleep(1.0)
    assert [(v.value, v.quality) for v in rig.sink.values("current")] == [(None, Quality.BAD)]
    assert all(value.quality is Quality.GOOD for value in rig.sink.values("current_pct"))


@virtually
async def test_a_row_given_up_is_asked_again_after_a_silence() -> None:
    rig = await Rig().online()
    rig.line.rules.append(refuse_p003)
    rig.poll()
    rig.poll()
    rig.line.rules.clear()

    rig.lose()
    rig.poll()
    rig.poll()
    await asyncio.sleep(1.0)

    assert rig.sink.values("current")[-1].quality is Quality.GOOD
    assert set(rig.line.polls) == {poll.key for poll in rig.telemetry.polls()}


@virtually
async def test_what_is_polled_fast_stays_fast_when_its_block_is_split() -> None:
    rig = await Rig().online()
    rig.unit.holding[VB01] = READY | FAULT
    rig.poll(STATUS)
    rig.line.rules.append(refuse_p003)

    rig.poll(VALUES)

    assert rig.line.every_s["pump-1/values:P003"] == 0.25


@virtually
async def test_an_answer_to_a_poll_that_was_removed_is_ignored() -> None:
    rig = await Rig().online()

    rig.telemetry.on_poll("pump-1/values:gone", Silent())

    assert rig.sink.records == []


@virtually
async def test_identification_fills_in_what_the_configuration_leaves_open() -> None:
    rig = Rig("ssw06")
    rig.unit.objects = {0: "WEG", 1: "SSW-06 820.0A", 2: "V1.60"}
    rig.unit.holding[P003] = 1234
    rig.telemetry.start()
    rig.poll()
    assert rig.telemetry.snapshot.readings["current"].value is None

    await asyncio.sleep(0.5)
    rig.poll()

    info = rig.sink.of(InfoRecord)[-1]
    assert (info.model, info.firmware, info.address, info.line) == ("SSW-06 820.0A", "1.60", 7, "pumps")
    assert rig.telemetry.snapshot.readings["current"].value == 1234.0


@virtually
async def test_the_configuration_wins_over_the_identification() -> None:
    rig = await Rig("ssw06", variant=Variant(rated_current_a=85.0)).online()
    rig.unit.objects = {0: "WEG", 1: "SSW-06 820.0A", 2: "V1.60"}
    rig.unit.holding[P003] = 1234

    rig.poll()

    assert rig.telemetry.variant.rated_current_a == 85.0
    assert rig.telemetry.snapshot.readings["current"].value == 123.4


@virtually
async def test_info_names_every_point_and_the_commands() -> None:
    rig = Rig()

    rig.telemetry.start()

    (info,) = rig.sink.of(InfoRecord)
    assert info.points["current"] == {
        "code": "P003",
        "unit": "A",
        "type": "float",
        "enum": None,
        "deadband": 0.5,
    }
    assert info.points["running"]["type"] == "boolean"
    assert {"start", "stop", "read", "set"} <= set(info.commands)


@virtually
async def test_closing_leaves_no_timer_and_no_task_behind() -> None:
    rig = Rig()
    rig.telemetry.start()
    rig.poll()

    await rig.telemetry.close()
    rig.sink.clear()
    await asyncio.sleep(100.0)

    assert rig.sink.records == []
    assert len(asyncio.all_tasks()) == 1


def refuse_p003(request: Request) -> Outcome | None:
    is_hit = isinstance(request, ReadHoldingRegisters) and P003 in range(
        request.address, request.address + request.count
    )
    return Refused(2, at_s=0.0) if is_hit else None
