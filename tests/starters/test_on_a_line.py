"""All but MQTT on a simulated line with a starter of each family, in virtual time."""

from __future__ import annotations

import asyncio

import pytest

from gateway.families.profile.load import FAMILIES
from gateway.records import (
    AlarmRecord,
    AvailabilityRecord,
    EventRecord,
    Phase,
    Quality,
    ResultRecord,
    StateRecord,
    ValueRecord,
)
from gateway.sim.bus.faults import Noisy
from tests.starters.four_starters import LostWrites, bring_to_ready, site
from tests.starters.rig import virtually


@pytest.mark.parametrize("family", FAMILIES)
@virtually
async def test_a_motor_is_started_and_stopped_by_one_start_frame(family: str) -> None:
    async with site() as here:
        await bring_to_ready(here, family)

        here.submit(family, "start", "1")
        await asyncio.sleep(30.0)
        here.submit(family, "stop", "2")
        await asyncio.sleep(30.0)

        assert here.sink.phases("1") == [("accepted", "ok"), ("written", "ok"), ("confirmed", "ok")]
        assert here.sink.phases("2") == [("accepted", "ok"), ("written", "ok"), ("confirmed", "ok")]
        assert len(here.unit(family).start_frames) == 1
        assert not here.unit(family).motor.is_turned_on
        events = [e.code for e in here.sink.of(EventRecord) if e.starter == family]
        assert [code for code in events if code != "memory_written"] == ["started", "stopped"]


@pytest.mark.parametrize("family", FAMILIES)
@virtually
async def test_a_stop_right_after_a_start_leaves_the_motor_stopped(family: str) -> None:
    async with site() as here:
        await bring_to_ready(here, family)

        here.submit(family, "start", "1")
        await asyncio.sleep(0.05)
        here.submit(family, "stop", "2")
        await asyncio.sleep(60.0)

        assert here.sink.final("1").code == "stopped_first"
        assert here.sink.final("2").phase is Phase.CONFIRMED
        assert not here.unit(family).motor.is_turned_on


@virtually
async def test_all_starters_are_read_and_identified() -> None:
    async with site() as here:
        for family, telemetry in here.telemetries.items():
            assert telemetry.is_answering
            assert telemetry.identity_reason == "", family
            bad = [n for n, r in telemetry.snapshot.readings.items() if r.quality is Quality.STALE]
            assert bad == [], family


@virtually
async def test_one_lost_starter_is_stale_and_the_others_stay_good() -> None:
    async with site() as here:
        here.bus.remove(here.unit("ssw07"))
        await asyncio.sleep(60.0)

        lost = {(r.starter, r.state) for r in here.sink.of(AvailabilityRecord)}
        assert lost == {("ssw07", "offline")}
        latest = {(r.starter, r.point): r.quality for r in here.sink.of(ValueRecord)}
        assert {quality for (name, _), quality in latest.items() if name == "ssw07"} <= {
            Quality.STALE,
            Quality.BAD,
        }
        assert Quality.STALE not in {quality for (name, _), quality in latest.items() if name != "ssw07"}


@virtually
async def test_an_unplugged_adapter_takes_all_starters_offline_and_back() -> None:
    async with site() as here:
        here.bus.unplug()
        await asyncio.sleep(30.0)
        assert {t.is_answering for t in here.telemetries.values()} == {False}

        here.bus.plug_in()
        await asyncio.sleep(30.0)

        assert {t.is_answering for t in here.telemetries.values()} == {True}
        assert {t.identity_reason for t in here.telemetries.values()} == {""}


@virtually
async def test_nothing_is_written_without_a_command() -> None:
    async with site() as here:
        await asyncio.sleep(120.0)
        here.bus.unplug()
        await asyncio.sleep(5.0)
        here.bus.plug_in()
        await asyncio.sleep(30.0)

        assert [write for unit in here.bus.units for write in unit.writes] == []


TRIPS = {"ssw06": 5, "ssw07": 5, "ssw900": 5, "sst": 12}


@pytest.mark.parametrize("family", FAMILIES)
@virtually
async def test_a_fault_is_published_and_can_be_reset_without_starting_the_motor(family: str) -> None:
    async with site() as here:
        await bring_to_ready(here, family)
        here.submit(family, "start", "1")
        await asyncio.sleep(30.0)
        here.sink.clear()
        here.unit(family).trip(TRIPS[family])
        await asyncio.sleep(5.0)
        fault = next(e for e in here.sink.of(EventRecord) if e.code == "fault")
        active = {alarm.code: alarm.is_active for alarm in here.sink.of(AlarmRecord)}

        here.submit(family, "reset", "2")
        await asyncio.sleep(30.0)

        assert fault.data["from"] == "running"
        assert max(moment["values"]["current"] for moment in fault.data["before"]) > 0
        assert True in active.values()
        assert here.sink.final("2").phase is Phase.CONFIRMED
        assert {a.code: a.is_active for a in here.sink.of(AlarmRecord)} == dict.fromkeys(active, False)
        assert not here.unit(family).motor.is_turned_on
        assert len(here.unit(family).start_frames) == 1


@pytest.mark.parametrize("family", FAMILIES)
@virtually
async def test_a_start_whose_answer_is_lost_is_sent_once_and_confirmed(family: str) -> None:
    async with site() as here:
        await bring_to_ready(here, family)
        unit = here.unit(family)
        here.bus.impair(unit.address, LostWrites())

        here.submit(family, "start", "1")
        await asyncio.sleep(30.0)

        assert len(unit.start_frames) == 1
        assert here.sink.final("1").phase is Phase.CONFIRMED


@virtually
async def test_a_noisy_line_never_makes_a_start_go_out_twice_or_a_false_state() -> None:
    async with site() as here:
        here.bus.noise = Noisy(0.002)

        for round_ in range(8):  # more would trip the overload
            here.submit("ssw07", "start", f"start {round_}")
            await asyncio.sleep(8.0)
            here.submit("ssw07", "stop", f"stop {round_}")
            await asyncio.sleep(22.0)

        unit = here.unit("ssw07")
        accepted = [
            r.id for r in here.sink.of(ResultRecord) if r.verb == "start" and r.phase is Phase.WRITTEN
        ]
        assert len(unit.start_frames) <= len(accepted)
        finals = [r.id for r in here.sink.of(ResultRecord) if r.phase.is_final]
        assert len(finals) == len(set(finals)) == 16
        assert {r.state for r in here.sink.of(StateRecord) if r.starter == "ssw07"} <= {
            "ready",
            "starting",
            "running",
            "stopping",
            "unknown",
        }
