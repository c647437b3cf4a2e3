from __future__ import annotations

import asyncio

import pytest

from gateway.families.profile.schema import Variant
from gateway.records import AlarmRecord, EventRecord, Quality, StateRecord
from gateway.starters.telemetry.transitions import PublishedFaults
from tests.starters.fakes import ACCELERATING, AT_SPEED, FAULT, P003, P014, READY, REMOTE, RUNNING, VB01
from tests.starters.plant import FakeMemory
from tests.starters.rig import Rig, virtually

STATUS, VALUES = "pump-1/status:VB01", "pump-1/values:P002"
STALE = Quality.STALE


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
async def test_the_configuration_wins_over_the_identification() -> None:
    rig = await Rig("ssw06", variant=Variant(rated_current_a=85.0)).online()
    rig.unit.objects = {0: "WEG", 1: "SSW-06 820.0A", 2: "V1.60"}
    rig.unit.holding[P003] = 1234

    rig.poll()

    assert rig.telemetry.variant.rated_current_a == 85.0
    assert rig.telemetry.snapshot.readings["current"].value == 123.4


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
