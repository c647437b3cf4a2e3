"""Simulated starters over hours: their counters, limits and estimates, as they are published and stored."""

import asyncio
import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import pytest

from gateway.app.history.counters import CountersPart
from gateway.families.profile.load import FAMILIES, load_profile
from gateway.history.own_points import own_points
from gateway.records import InfoRecord, Quality, StartRecord, ValueRecord
from gateway.sim.factory import make_unit
from gateway.starters.policy.start_rules import RuleSet
from gateway.storage.history_table import HistoryRow
from tests.history.history_site import site, virtually

HOUR_S = 3600.0


@pytest.mark.parametrize("family", FAMILIES)
@virtually
async def test_info_has_the_gateways_own_points_and_each_has_a_value(family: str, tmp_path: Path) -> None:
    async with site(make_unit(family, 1), tmp_path) as here:
        await asyncio.sleep(5.0)

        (info,) = here.sink.of(InfoRecord)[:1]
        names = [point.name for point in own_points(load_profile(family))]
        assert {"hours_total", "trips_total", "starts_left", "pause_left_s", "standstill_s"} <= set(names)
        assert info.points.keys() >= set(names)
        assert all(here.sink.values(name) for name in names)
        kinds = {"float": float, "integer": int, "string": str}
        for name in names:
            value = here.value(name).value
            assert value is None or type(value) is kinds[info.points[name]["type"]]


@pytest.mark.parametrize("family", FAMILIES)
@virtually
async def test_half_an_hour_of_running_is_half_an_hour(family: str, tmp_path: Path) -> None:
    async with site(make_unit(family, 1), tmp_path, every_s=5.0) as here:
        await asyncio.sleep(10.0)
        here.start()
        await asyncio.sleep(HOUR_S / 2)
        here.stop()
        await asyncio.sleep(120.0)

        hours = here.value("hours_total")
        assert hours.quality is Quality.GOOD
        assert hours.value == pytest.approx(0.5, abs=0.01)
        if family != "sst":  # without a rated current there is no load
            bands = [here.value(f"hours_{name}").value for name in ("low", "normal", "high", "over")]
            assert sum(bands) == pytest.approx(0.5, abs=0.01)
            assert max(bands) == bands[1]


@virtually
async def test_energy_agrees_with_the_motors_own(tmp_path: Path) -> None:
    unit = make_unit("ssw06", 1)
    async with site(unit, tmp_path) as here:
        await asyncio.sleep(10.0)
        here.start()
        await asyncio.sleep(900.0)
        here.stop()
        await asyncio.sleep(120.0)

        assert here.value("energy_kwh").value == pytest.approx(unit.motor.energy_kwh, rel=0.03)


@virtually
async def test_the_starters_own_counters_win(tmp_path: Path) -> None:
    unit = make_unit("ssw900", 1)
    unit.motor.running_s, unit.motor.energy_kwh = 500 * HOUR_S, 1234.5
    async with site(unit, tmp_path) as here:
        await asyncio.sleep(130.0)

        assert here.value("hours_total").value == pytest.approx(500.0, abs=0.1)
        assert here.value("energy_kwh").value == pytest.approx(1234.5, abs=0.2)
        assert {each.value for each in here.sink.values("hours_total")} <= {None, 500.0}
        assert "starts_total" not in {point.name for point in own_points(load_profile("ssw900"))}


@virtually
async def test_a_value_that_grows_is_published_once_a_minute(tmp_path: Path) -> None:
    async with site(make_unit("ssw07", 1), tmp_path) as here:
        await asyncio.sleep(10.0)
        here.start()
        await asyncio.sleep(900.0)

        assert 12 <= len(here.sink.values("hours_total")) <= 18
        own = {point.name for point in own_points(load_profile("ssw07"))}
        count = sum(1 for each in here.sink.of(ValueRecord) if each.point in own)
        assert count < 15 * 6


@virtually
async def test_a_start_counts_with_its_record_and_both_are_one_transaction(tmp_path: Path) -> None:
    async with site(make_unit("ssw07", 1), tmp_path) as here:
        on_disk: list[tuple[int, int]] = []
        here.file.on_flush = lambda rows: on_disk.append((_kinds(rows, "start"), _starts_counted(rows)))
        await asyncio.sleep(10.0)
        for _ in range(2):
            here.start()
            await asyncio.sleep(30.0)
            here.stop()
            await asyncio.sleep(60.0)

        assert here.value("starts_total").value == len(here.sink.of(StartRecord)) == 2
        assert {records for records, _ in on_disk} >= {1, 2}
        assert all(records == counted for records, counted in on_disk), "whenever it is killed"


@virtually
async def test_a_start_that_a_silence_hides_counts_as_it_is_recorded(tmp_path: Path) -> None:
    unit = make_unit("ssw07", 1)
    unit.motor.data = replace(unit.motor.data, ramp_up_s=25.0)
    async with site(unit, tmp_path) as here:
        await asyncio.sleep(10.0)
        for _ in range(2):  # from rest; then it stops and starts again within the silence
            here.bus.unplug()
            await asyncio.sleep(10.0)
            here.stop()
            await asyncio.sleep(60.0)
            here.start()
            await asyncio.sleep(5.0)
            here.bus.plug_in()
            await asyncio.sleep(120.0)

        outcomes = [record.data["outcome"] for record in here.sink.of(StartRecord)]
        assert outcomes == ["full_voltage", "full_voltage"]
        assert here.value("starts_total").value == 2


@virtually
async def test_a_start_that_ends_with_the_starters_configuration_counts(tmp_path: Path) -> None:
    async with site(make_unit("ssw07", 1), tmp_path) as here:
        await asyncio.sleep(10.0)
        here.start()
        await asyncio.sleep(3.0)
        here.history.follow([], changed=[])

        assert len(here.sink.of(StartRecord)) == 1
        assert _starts_counted(here.file.rows) == 1


def _kinds(rows: Mapping[tuple[str, str, str], HistoryRow], kind: str) -> int:
    return sum(row.kind == kind for row in rows.values())


def _starts_counted(rows: Mapping[tuple[str, str, str], HistoryRow]) -> int:
    return sum(row.data["totals"]["starts"] for row in rows.values() if row.kind == "counters")


@virtually
async def test_a_silent_starter_has_stale_counters_and_does_not_count(tmp_path: Path) -> None:
    async with site(make_unit("ssw07", 1), tmp_path) as here:
        await asyncio.sleep(10.0)
        here.start()
        await asyncio.sleep(600.0)
        here.bus.unplug()
        await asyncio.sleep(30.0)
        before = here.value("hours_total")
        assert before.quality is Quality.STALE
        await asyncio.sleep(600.0)
        here.bus.plug_in()
        await asyncio.sleep(600.0)

        after = here.value("hours_total")
        assert after.quality is Quality.GOOD
        assert after.value == pytest.approx(1200 / HOUR_S, abs=0.02)
        assert before.time_s == pytest.approx(here.clock.utc_s(610.0), abs=5.0)


@virtually
async def test_steps_of_the_wall_clock_add_no_hours(tmp_path: Path) -> None:
    async with site(make_unit("ssw07", 1), tmp_path) as here:
        await asyncio.sleep(10.0)
        here.start()
        for step_s in (86_400.0, -3 * 86_400.0, 365 * 86_400.0):
            here.clock.epoch_s += step_s
            await asyncio.sleep(200.0)

        assert here.value("hours_total").value == pytest.approx(600 / HOUR_S, abs=0.02)


@virtually
async def test_starts_left_count_down_and_the_last_but_one_is_an_event(tmp_path: Path) -> None:
    rules = RuleSet(starts_per_hour=3, minimum_pause_s=120.0)
    async with site(make_unit("ssw07", 1), tmp_path, rules=rules, every_s=5.0) as here:
        await asyncio.sleep(300.0)
        seen = [here.value("starts_left").value]
        for _ in range(3):
            here.start()
            await asyncio.sleep(60.0)
            here.stop()
            await asyncio.sleep(200.0)
            seen.append(here.value("starts_left").value)

        assert seen == [3, 2, 1, 0]
        (event,) = here.events("one_start_left")
        assert event.severity.value == "warning"
        pause = here.value("pause_left_s").value
        assert isinstance(pause, float)
        assert pause == pytest.approx(HOUR_S - 2 * 260.0 - 260.0, abs=75.0)
        await asyncio.sleep(HOUR_S)
        assert here.value("starts_left").value == 3
        assert here.value("pause_left_s").value == 0.0
        assert len(here.events("one_start_left")) == 1


@virtually
async def test_a_pause_that_becomes_longer_is_published_at_once(tmp_path: Path) -> None:
    rules = RuleSet(starts_per_hour=2, minimum_pause_s=120.0)
    async with site(make_unit("ssw07", 1), tmp_path, rules=rules) as here:
        await asyncio.sleep(10.0)
        for _ in range(2):
            here.start()
            await asyncio.sleep(3.0)
            here.stop()
            await asyncio.sleep(2.0)

        assert here.value("starts_left").value == 0
        assert here.value("pause_left_s").value == pytest.approx(HOUR_S, abs=15.0)


@virtually
async def test_the_pause_after_a_stop_runs_down(tmp_path: Path) -> None:
    async with site(make_unit("ssw07", 1), tmp_path, rules=RuleSet(minimum_pause_s=300.0)) as here:
        await asyncio.sleep(400.0)
        assert here.value("pause_left_s").value == 0.0
        here.start()
        await asyncio.sleep(60.0)
        here.stop()
        await asyncio.sleep(100.0)
        assert 190.0 <= float(here.value("pause_left_s").value or 0) <= 300.0
        await asyncio.sleep(300.0)

        assert here.value("pause_left_s").value == 0.0
        assert float(here.value("standstill_s").value or 0) > 280.0


@virtually
async def test_the_pause_that_the_starter_demands_counts_too(tmp_path: Path) -> None:
    unit = make_unit("ssw900", 1, settings={932: 900})  # C5.7.2: 90.0 s after a stop
    async with site(unit, tmp_path) as here:
        await asyncio.sleep(120.0)
        here.start()
        await asyncio.sleep(60.0)

        assert here.value("pause_left_s").value == 90.0


@virtually
async def test_after_a_thermal_trip_the_time_to_restart_is_estimated(tmp_path: Path) -> None:
    unit = make_unit("ssw07", 1)
    unit.motor.load_pct = 200.0
    async with site(unit, tmp_path, every_s=5.0) as here:
        await asyncio.sleep(10.0)
        here.start()
        await asyncio.sleep(360.0)
        assert here.trips()[0]["code"] == "e05"
        await asyncio.sleep(unit.motor.data.cooling_s * math.log(unit.motor.thermal_pct / 85.0))
        estimate = here.value("restart_in_s")
        (part,) = (part for part in here.history.starters["pump"].parts if isinstance(part, CountersPart))
        assert part._thermal is not None
        cooling_s = unit.motor.data.cooling_s * math.log(85.0 * 2.5 / part._thermal.restart_level)
        took_s = cooling_s + here.clock.utc_s() - (estimate.time_s or 0.0)

        assert estimate.value == pytest.approx(took_s, rel=0.15)
        await asyncio.sleep(cooling_s * 1.2 + 120.0)
        assert here.value("restart_in_s").value == 0.0


async def until(is_true: Callable[[], bool]) -> None:
    for _ in range(3600):
        if is_true():
            return
        await asyncio.sleep(1.0)
    raise TimeoutError


@pytest.mark.parametrize(
    ("family", "settings", "share", "outcome"),
    [
        ("ssw07", {}, 1.0, "full_voltage"),
        ("ssw900", {946: 30}, 1.0, "full_voltage"),  # C5.9.7.7: 30 min, as the motor's
        ("ssw900", {946: 30}, 0.1, "tripped"),  # an SSW-07 gives no estimate before it has cooled by a tenth
    ],
)
@virtually
async def test_a_motor_that_has_tripped_starts_when_the_time_is_over_and_not_before(
    family: str, settings: dict[int, int], share: float, outcome: str, tmp_path: Path
) -> None:
    unit = make_unit(family, 1, settings=settings)
    async with site(unit, tmp_path, every_s=1.0) as here:
        await asyncio.sleep(60.0)
        here.start()  # it shows how much a start heats
        await asyncio.sleep(60.0)
        unit.motor.load_pct = 200.0
        await until(lambda: bool(here.trips()))
        unit.motor.load_pct = 70.0
        await until(lambda: here.value("restart_in_s").value not in (None, 0.0))
        estimate = here.value("restart_in_s")
        unit.reset_at_keypad()  # type: ignore[attr-defined]
        wait_s = float(estimate.value or 0) - (here.clock.utc_s() - (estimate.time_s or 0.0))
        await asyncio.sleep(max(share * wait_s, 0.0))
        records = len(here.sink.of(StartRecord))
        here.start()
        await asyncio.sleep(60.0)

        assert here.sink.of(StartRecord)[records].data["outcome"] == outcome


@virtually
async def test_damaged_counters_count_as_none(tmp_path: Path) -> None:
    rows = [HistoryRow("pump", "counters", "b", 0.0, {"totals": {"operating_s": "much"}})]
    async with site(make_unit("ssw07", 1), tmp_path, rows=rows) as here:
        await asyncio.sleep(5.0)

        assert here.value("hours_total").value == 0.0
