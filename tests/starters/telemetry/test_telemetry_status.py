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
async def test_one_round_of_all_polls_gives_the_state_once_it_is_identified(family: str) -> None:
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
async def test_an_unchanged_state_is_published_again_within_thirty_seconds() -> None:
    rig = await Rig().online()

    await rig.poll_for(31.0)

    assert rig.sink.states() == ["ready"]
    assert rig.sink.values("running") == []


@virtually
async def test_an_unchanged_value_is_published_again_within_five_minutes() -> None:
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
async def test_a_fault_is_published_with_the_values_before_it() -> None:
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
    rig.poll()
    assert rig.sink.of(EventRecord) == []
    await asyncio.sleep(0.25)
    rig.poll()
    (event,) = rig.sink.of(EventRecord)
    assert (event.code, event.text) == ("fault", "fault E05 Motor overload")
    assert event.data["faults"] == [{"code": "e05", "text": "Motor overload", "count": 1}]
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
    assert alarms == [("e05", True)]
    assert "cleared" not in rig.sink.events()
    assert [each.fault_code for each in rig.sink.of(StateRecord)] == [None, 5]


@virtually
async def test_a_state_carries_the_number_of_its_fault_no_longer_than_the_fault_lasts() -> None:
    rig = await Rig().online()
    rig.unit.holding |= {VB01: READY | FAULT, P014: 5}
    await rig.poll_for(5.0)
    rig.unit.holding[VB01] = READY
    await rig.poll_for(5.0)

    assert rig.sink.values("fault_code")[-1].value == 5  # which the starter keeps
    assert [(each.state, each.fault_code) for each in rig.sink.of(StateRecord)][-2:] == [
        ("fault", 5),
        ("ready", None),
    ]


@virtually
async def test_one_trip_is_one_alarm_and_one_event_by_its_name_until_it_is_reset() -> None:
    rig = await Rig().online()
    await rig.poll_for(5.0)
    rig.sink.clear()
    rig.unit.holding |= {VB01: READY | FAULT, P014: 74}
    await rig.poll_for(30.0)
    rig.unit.holding |= {VB01: READY}
    await rig.poll_for(30.0)

    name = "Current imbalance (as F074 of the SSW900, not in this manual)"
    assert [(a.code, a.is_active, a.text) for a in rig.sink.of(AlarmRecord)] == [
        ("e74", True, name),
        ("e74", False, name),
    ]
    assert [(e.code, e.text) for e in rig.sink.of(EventRecord)] == [
        ("fault", f"fault E74 {name}"),
        ("cleared", f"cleared: E74 {name}"),
    ]


@virtually
async def test_a_further_fault_during_a_fault_is_an_event_of_its_own() -> None:
    rig = await Rig().online()
    rig.unit.holding |= {VB01: READY | FAULT, P014: 5}
    await rig.poll_for(10.0)
    rig.sink.clear()
    rig.unit.holding[P014] = 42
    await rig.poll_for(10.0)

    assert [(e.code, e.text) for e in rig.sink.of(EventRecord)] == [
        ("alarm", "fault E42 (not in the manual)")
    ]


@virtually
async def test_a_fault_whose_number_stays_0_is_published_without_one_two_seconds_later() -> None:
    rig = await Rig().online()
    rig.unit.holding[P014] = 0
    await rig.poll_for(5.0)
    rig.sink.clear()
    rig.unit.holding[VB01] = READY | FAULT
    begun_s = rig.clock.utc_s()
    await rig.poll_for(1.5)
    assert rig.sink.of(AlarmRecord) == []
    await rig.poll_for(10.0)

    (alarm,) = rig.sink.of(AlarmRecord)
    (event,) = rig.sink.of(EventRecord)
    assert (alarm.code, alarm.text) == ("fault", "Fault, its number is not known")
    assert alarm.time_s == pytest.approx(begun_s + 2.0, abs=1.0)
    assert (event.code, event.text) == ("fault", "fault, its number is not known")


@virtually
async def test_a_fault_whose_number_cannot_be_read_is_published_without_one_ten_seconds_later() -> None:
    rig = await Rig().online()
    rig.sink.clear()
    rig.unit.holding[VB01] = READY | FAULT
    for _ in range(36):
        await asyncio.sleep(0.25)
        rig.poll(STATUS)
    assert rig.sink.of(AlarmRecord) + rig.sink.of(EventRecord) == []
    for _ in range(8):
        await asyncio.sleep(0.25)
        rig.poll(STATUS)

    assert [alarm.code for alarm in rig.sink.of(AlarmRecord)] == ["fault"]
    assert rig.sink.events() == ["fault"]


@virtually
async def test_a_fault_that_is_over_before_its_number_is_read_is_an_event_all_the_same() -> None:
    rig = await Rig().online()
    rig.sink.clear()
    for word in (READY | FAULT, READY | FAULT, READY, READY):
        rig.unit.holding[VB01] = word
        rig.poll(STATUS)
        await asyncio.sleep(0.25)

    assert [e.text for e in rig.sink.of(EventRecord)] == [
        "fault, its number is not known",
        "cleared: Fault, its number is not known",
    ]


@virtually
async def test_a_family_that_gives_no_number_says_where_to_read_it() -> None:
    rig = await Rig("ssw06").online()
    rig.unit.holding[VB01] = READY | FAULT
    await rig.poll_for(3.0)

    assert [a.text for a in rig.sink.of(AlarmRecord)] == ["Fault, its number can be read at the starter only"]
    assert [e.text for e in rig.sink.of(EventRecord)] == ["fault, its number can be read at the starter only"]


@virtually
async def test_all_errors_of_one_trip_of_an_sst_are_one_event() -> None:
    rig = await Rig("sst").online()
    rig.sink.clear()
    for coil in (9, 12, 17):
        rig.unit.coils[coil - 1] = 1
    await rig.poll_for(5.0)

    assert [(e.code, e.text) for e in rig.sink.of(EventRecord)] == [
        ("fault", "fault COIL12 Overcurrent, COIL17 Phase loss")
    ]


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
        "name": "motor current",
        "meaning": "mean current of the motor's phases",
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
async def test_a_fault_that_stands_at_the_first_reading_is_published_once() -> None:
    rig = Rig()
    rig.unit.holding |= {VB01: READY | FAULT, P014: 5}
    rig.telemetry.start()
    await rig.poll_for(60.0)

    assert rig.sink.events().count("fault") == 1


@virtually
async def test_a_fault_that_an_earlier_run_published_is_not_published_again_but_another_is() -> None:
    memory = FakeMemory()

    async def run(number: int) -> list[str]:
        rig = Rig(published_faults=PublishedFaults(memory=memory))
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
async def test_a_fault_whose_event_may_not_be_on_the_disk_is_published_again() -> None:
    memory = FakeMemory()
    for _ in range(2):
        rig = Rig(published_faults=PublishedFaults(memory=memory))
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


@virtually
async def test_a_fault_whose_starter_is_lost_before_its_number_is_read_is_an_event_all_the_same() -> None:
    rig = await Rig().online()
    rig.sink.clear()
    rig.unit.holding[VB01] = READY | FAULT
    for _ in range(2):
        rig.poll(STATUS)
        await asyncio.sleep(0.25)

    rig.lose()

    faults = [event for event in rig.sink.of(EventRecord) if event.code == "fault"]
    assert [(event.text, event.data["faults"]) for event in faults] == [
        ("fault, its number is not known", [])
    ]


@virtually
async def test_an_error_that_is_gone_before_the_whole_state_is_read_twice_came_and_went() -> None:
    rig = await Rig("sst").online()
    await rig.poll_for(3.0)
    rig.sink.clear()
    coils = next(key for key in rig.line.polls if "COIL" in key)
    for is_set in (True, True, False, False):
        rig.unit.coils |= {8: is_set, 16: is_set}
        rig.poll(coils)
        await asyncio.sleep(0.25)

    assert [(event.code, event.text) for event in rig.sink.of(EventRecord)] == [
        ("alarm", "fault COIL17 Phase loss"),
        ("cleared", "cleared: COIL17 Phase loss"),
    ]
