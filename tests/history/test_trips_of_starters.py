"""Simulated starters that trip: what their records hold."""

import asyncio
import json
from pathlib import Path
from typing import Any

import comtrade
import pytest

from gateway.families.profile.load import FAMILIES, load_profile
from gateway.history.export import recording_of, to_comtrade
from gateway.history.trip_record import MOST_BYTES
from gateway.history.trip_recorder import AFTER_S, LATEST_S
from gateway.mqtt.contract.payloads import to_payload
from gateway.sim.factory import make_unit
from gateway.sim.weg.command_sources import P_TIMEOUT
from tests.history.history_site import MotorSite, site, virtually

FAULTS = {"ssw06": 5, "ssw07": 5, "ssw900": 5, "sst": 12}


async def tripped(here: MotorSite, family: str, *, after_s: float = 90.0) -> float:
    """Start a motor and let it trip; the time of the trip."""
    await asyncio.sleep(10.0)
    here.start()
    await asyncio.sleep(after_s)
    here.unit.advance(here.clock.now_s())
    here.unit.trip(FAULTS[family])
    return here.clock.now_s()


@pytest.mark.parametrize("family", FAMILIES)
@virtually
async def test_a_trip_leaves_a_record_of_the_minute_before_it(family: str, tmp_path: Path) -> None:
    async with site(make_unit(family, 1), tmp_path) as here:
        trip_s = await tripped(here, family)
        await asyncio.sleep(LATEST_S + 5.0)

        (trip,) = here.trips()
        readings = trip["readings"]
        seen = dict(zip(readings["t_s"], readings["points"]["running"], strict=True))
        assert readings["t_s"][0] <= -50.0
        assert all(value is not False for t_s, value in seen.items() if t_s < 0)
        flag = dict(zip(readings["t_s"], readings["points"]["fault"], strict=True))
        assert flag[0.0] is True
        assert True not in [value for t_s, value in flag.items() if t_s < 0]
        assert trip["state_before"] == "running"
        assert trip["time"].startswith("20")
        (event,) = here.events("fault")
        assert event.time_s == pytest.approx(here.clock.utc_s(trip_s), abs=1.5)
        assert len(to_payload(trip)) <= MOST_BYTES
        assert trip["id"] == f"boot-1-{trip['seq']}"
        assert here.rows("trip")[0].data == trip


@pytest.mark.parametrize("family", FAMILIES)
@virtually
async def test_a_record_says_what_the_starter_stores_of_the_fault(family: str, tmp_path: Path) -> None:
    async with site(make_unit(family, 1), tmp_path) as here:
        await tripped(here, family)
        await asyncio.sleep(LATEST_S + 5.0)

        (trip,) = here.trips()
        rows = load_profile(family).history
        assert trip["at_fault"]
        assert trip["at_fault"].keys() <= set(rows.at_fault)
        assert all(each["name"] and "value" in each for each in trip["at_fault"].values())
        assert [each["code"] for each in trip["fault_history"]] == list(rows.fault_history)
        assert list(here.unit.writes) == []


@virtually
async def test_the_fault_history_names_the_faults(tmp_path: Path) -> None:
    async with site(make_unit("ssw07", 1), tmp_path) as here:
        await tripped(here, "ssw07")
        await asyncio.sleep(LATEST_S)

        (trip,) = here.trips()
        assert trip["code"] == "e05"
        assert trip["fault_history"][0]["alarm"] == "e05"
        assert trip["fault_history"][0]["value"] == 5


@virtually
async def test_a_record_is_there_soon_after_the_trip(tmp_path: Path) -> None:
    async with site(make_unit("ssw07", 1), tmp_path) as here:
        await tripped(here, "ssw07")
        await asyncio.sleep(AFTER_S + 3.0)

        assert len(here.trips()) == 1


@virtually
async def test_what_a_starter_refuses_is_left_out(tmp_path: Path) -> None:
    unit = make_unit("ssw07", 1)
    answered = unit.handle

    def refusing(pdu: bytes, now_s: float) -> bytes | None:
        first, count = int.from_bytes(pdu[1:3]), int.from_bytes(pdu[3:5])
        is_among = pdu[0] == 3 and not {15, 16, 17}.isdisjoint(range(first, first + count))
        return bytes((0x83, 0x02)) if is_among else answered(pdu, now_s)

    unit.handle = refusing  # type: ignore[method-assign]
    async with site(unit, tmp_path) as here:
        await tripped(here, "ssw07")
        await asyncio.sleep(LATEST_S + 5.0)

        (trip,) = here.trips()
        assert [each["code"] for each in trip["fault_history"]] == ["P014"]
        assert "P050" in trip["at_fault"]


@virtually
async def test_a_starter_that_falls_silent_with_its_trip_has_a_record(tmp_path: Path) -> None:
    async with site(make_unit("ssw07", 1), tmp_path) as here:
        await tripped(here, "ssw07")
        await asyncio.sleep(0.8)  # two readings have shown it
        here.unit.power_off()
        await asyncio.sleep(LATEST_S + 5.0)

        (trip,) = here.trips()
        assert trip["readings"]["t_s"][0] <= -50.0


@virtually
async def test_each_trip_has_its_own_record(tmp_path: Path) -> None:
    async with site(make_unit("ssw07", 1), tmp_path) as here:
        await tripped(here, "ssw07", after_s=30.0)
        await asyncio.sleep(LATEST_S)
        here.unit.power_off()
        await asyncio.sleep(5.0)
        here.unit.power_on()
        await asyncio.sleep(20.0)
        await tripped(here, "ssw07", after_s=30.0)
        await asyncio.sleep(LATEST_S)

        first, second = here.trips()
        assert first["id"] != second["id"]
        assert second["readings"]["t_s"][0] <= -20.0


@virtually
async def test_a_step_of_the_wall_clock_moves_nothing_within_a_record(tmp_path: Path) -> None:
    async with site(make_unit("ssw07", 1), tmp_path) as here:
        await asyncio.sleep(10.0)
        here.start()
        await asyncio.sleep(80.0)
        here.clock.epoch_s -= 7200.0
        await tripped(here, "ssw07", after_s=20.0)
        await asyncio.sleep(LATEST_S)

        (trip,) = here.trips()
        assert trip["readings"]["t_s"][0] == pytest.approx(-60.0, abs=3.0)


@pytest.mark.parametrize("family", FAMILIES)
@virtually
async def test_another_reader_reads_the_comtrade_of_a_trip(family: str, tmp_path: Path) -> None:
    async with site(make_unit(family, 1), tmp_path) as here:
        await tripped(here, family)
        await asyncio.sleep(LATEST_S + 5.0)

        trip: dict[str, Any] = json.loads(to_payload(here.trips()[0]))
        reader = comtrade.Comtrade(use_double_precision=True)
        reader.read(*to_comtrade(recording_of("pump", trip, units={})))
        fault = reader.status[reader.status_channel_ids.index("fault")]
        current = reader.analog[reader.analog_channel_ids.index("current")]
        at_trip = list(reader.time).index(pytest.approx(reader.trigger_time, abs=1e-3))
        assert list(fault[:at_trip]) == [0] * at_trip
        assert fault[at_trip] == 1
        assert max(current[:at_trip]) > 10.0


@virtually
async def test_a_trip_is_counted_in_the_transaction_that_stores_it(tmp_path: Path) -> None:
    async with site(make_unit("ssw07", 1), tmp_path) as here:
        put, waiting, written = here.file.put, [], []

        def note(starter: str, kind: str, id_: str, *, is_urgent: bool = False, **row: Any) -> None:
            put(starter, kind, id_, is_urgent=is_urgent, **row)
            waiting.append((kind, row["data"]))
            if is_urgent:  # everything that was put before it goes along
                written.extend(waiting)
                waiting.clear()

        here.file.put = note  # type: ignore[method-assign]
        await tripped(here, "ssw07", after_s=30.0)
        await asyncio.sleep(LATEST_S + 5.0)

        assert "trip" in [kind for kind, _ in written]
        counted = [data["totals"]["trips"] for kind, data in written if kind == "counters"]
        assert [sum(trips.values()) for trips in counted[-1:]] == [1]  # a kill loses no count of it


@virtually
async def test_a_setting_changed_at_the_keypad_is_stored(tmp_path: Path) -> None:
    async with site(make_unit("ssw07", 1), tmp_path) as here:
        await asyncio.sleep(600.0)  # all settings are known
        here.unit.settings[P_TIMEOUT] += 5
        await asyncio.sleep(1200.0)

        (row,) = here.rows("setting")
        (event,) = here.events("parameter_changed")
        assert row.data["parameter"] == f"P{P_TIMEOUT}"
        assert row.data["after"]["value"] == row.data["before"]["value"] + 5
        assert row.data["time"] is not None
        assert row.id == f"boot-1-{event.seq}"
