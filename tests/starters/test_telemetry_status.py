from __future__ import annotations

import asyncio

import pytest

from gateway.families.profile.load import FAMILIES
from gateway.families.profile.schema import Variant
from gateway.records import AlarmRecord, AvailabilityRecord, EventRecord, InfoRecord, Quality, StateRecord
from gateway.starters.telemetry.transitions import PublishedFaults
from tests.starters.fakes import ACCELERATING, AT_SPEED, FAULT, P003, P014, READY, REMOTE, RUNNING, VB01
from tests.starters.plant import FakeMemory
from tests.starters.rig import Rig, virtually

STATUS, VALUES = "pump-1/status:VB01", "pump-1/values:P002"
STALE = Quality.STALE


@pytest.mark.parametrize("family", FAMILIES)
@virtually
async def test_one_turn_of_all_polls_tells_the_state_once_it_is_identified(family: str) -> None:
    rig = Rig(family)
    rig.telemetry.start()

    rig.poll()
    await asyncio.sleep(0.5)

    assert rig.sink.states()[-1] == "ready"
    assert rig.telemetry.is_answering
    assert rig.sink.of(AvailabilityRecord)[-1].state == "online"


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
    assert rig.sink.values("running") == []


@virtually
async def test_an_unchanged_value_is_told_again_within_five_minutes() -> None:
    rig = await Rig().online()

    await rig.poll_for(301.0)

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
async def test_a_fault_is_told_with_the_values_before_it() -> None:
    rig = await Rig().online()
    rig.unit.holding |= {VB01: AT_SPEED, P003: 815}
    await asyncio.sleep(1.0)
    rig.poll()
    await asyncio.sleep(0.5)
    rig.poll()
    await asyncio.sleep(0.5)
    rig.unit.holding |= {VB01: REMOTE | FAULT, P003: 0, P014: 5}
    rig.sink.clear()

    rig.poll(STATUS)

    assert rig.sink.states() == ["fault"]
    assert rig.sink.of(EventRecord) == []
    await asyncio.sleep(0.25)
    rig.poll(STATUS)
    event = rig.sink.of(EventRecord)[-1]
    assert event.code == "fault"
    assert event.data["from"] == "running"
    assert event.data["before"][-1]["values"]["current"] == 81.5
    assert VALUES in rig.line.expedited


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
    await asyncio.sleep(1.0)
    rig.poll()
    rig.unit.holding[VB01] = READY

    rig.poll()

    last = rig.sink.of(AlarmRecord)[-1]
    assert (last.code, last.is_active, last.count) == ("e05", False, 1)
    assert last.cleared_s == rig.clock.utc_s()
    await asyncio.sleep(0.25)
    rig.poll()
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
    await asyncio.sleep(0.25)
    rig.poll(STATUS)

    assert rig.sink.events() == ["local_operation"]


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
async def test_what_one_reading_says_alone_is_no_event() -> None:
    rig = await Rig().online()
    for word in (AT_SPEED, READY, READY | FAULT, READY, READY & ~REMOTE, READY):
        rig.unit.holding[VB01] = word
        await asyncio.sleep(0.5)
        rig.poll(STATUS)

    assert rig.sink.states() == ["running", "ready", "fault", "ready", "ready", "ready"]
    assert rig.sink.events() == []


@virtually
async def test_a_change_has_the_status_read_again_at_once_and_bears_the_time_of_the_first_reading() -> None:
    rig = await Rig().online()
    rig.unit.holding[VB01] = AT_SPEED
    rig.line.expedited.clear()

    rig.poll(STATUS)
    first_s = rig.clock.utc_s()
    assert rig.line.expedited == [STATUS]
    await asyncio.sleep(0.3)
    rig.poll(STATUS)

    (event,) = rig.sink.of(EventRecord)
    assert (event.code, event.time_s) == ("started", first_s)


@virtually
async def test_a_fault_that_stands_at_the_first_reading_is_told_once() -> None:
    rig = Rig()
    rig.unit.holding |= {VB01: READY | FAULT, P014: 5}
    rig.telemetry.start()
    await rig.poll_for(60.0)

    assert rig.sink.events().count("fault") == 1


@virtually
async def test_a_fault_that_an_earlier_run_told_is_not_told_again_but_another_is() -> None:
    memory = FakeMemory()

    async def run(number: int) -> list[str]:
        rig = Rig(told_faults=PublishedFaults(memory=memory))
        rig.unit.holding |= {VB01: READY | FAULT if number else READY, P014: number}
        rig.telemetry.start()
        await rig.poll_for(20.0)
        return [code for code in rig.sink.events() if code == "fault"]

    assert await run(5) == ["fault"]
    assert await run(5) == []
    assert await run(7) == ["fault"]
    assert await run(0) == []
    assert await run(7) == ["fault"]


@virtually
async def test_a_fault_whose_event_may_not_be_on_the_disk_is_told_again() -> None:
    memory = FakeMemory()
    for _ in range(2):
        rig = Rig(told_faults=PublishedFaults(memory=memory))
        rig.unit.holding |= {VB01: READY | FAULT, P014: 5}
        rig.telemetry.start()
        await rig.poll_for(3.0)

        assert rig.sink.events().count("fault") == 1


@virtually
async def test_a_start_has_the_time_of_its_own_first_reading_not_of_another_points() -> None:
    rig = await Rig().online()
    words = (
        READY ^ REMOTE,
        (READY | RUNNING | ACCELERATING) ^ REMOTE,
        (READY | RUNNING | ACCELERATING) ^ REMOTE,
    )
    times_s = []

    for word in words:
        await asyncio.sleep(2.0)
        times_s.append(rig.clock.utc_s())
        rig.unit.holding[VB01] = word
        rig.poll(STATUS)

    (started,) = [each for each in rig.sink.of(EventRecord) if each.code == "started"]
    assert started.time_s == pytest.approx(times_s[1], abs=0.5)
