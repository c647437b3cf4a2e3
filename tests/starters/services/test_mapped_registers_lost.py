"""What makes the fast lane be left, or never entered."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from gateway.records import Phase, Quality, Severity, ValueRecord
from gateway.sim.core.requests import refuse_address
from gateway.sim.factory import make_unit
from gateway.starters.policy.write_budget import MOST_PER_HOUR
from gateway.starters.services.mapped_registers import MOST_WRITINGS
from tests.starters.mapped import FAST, MAP, STATUS, asked, map_writes
from tests.starters.one_starter import one_starter
from tests.starters.rig import virtually


@pytest.mark.parametrize("place", [0, 13, 21, 30])
@virtually
async def test_a_map_that_somebody_changes_is_left_at_once_and_no_wrong_value_is_published(
    place: int,
) -> None:
    async with one_starter(make_unit("ssw900", 1), has_fast_words=True) as here:
        await asyncio.sleep(10.0)
        shown = {name: reading.value for name, reading in here.telemetry.snapshot.readings.items()}
        here.sink.clear()
        here.bus.transcript.clear()

        here.unit._write_registers(1300 + place, [402])
        await asyncio.sleep(60.0)

        (event,) = here.events("fast_words_changed")
        assert event.severity is Severity.WARNING
        good = [r for r in here.sink.of(ValueRecord) if r.quality is Quality.GOOD]
        assert {r.point: r.value for r in good if shown[r.point] == 0} == {
            r.point: shown[r.point] for r in good if shown[r.point] == 0
        }
        assert [r for r in here.sink.of(ValueRecord) if r.quality is not Quality.GOOD] == []
        assert asked(here, FAST) <= 2
        assert asked(here, STATUS) > 50
        assert len(map_writes(here)) == 1  # ours: it is not fought over


@virtually
async def test_another_family_behind_the_address_refuses_the_words_and_all_is_read_as_before() -> None:
    async with one_starter(make_unit("ssw900", 1), has_fast_words=True) as here:
        await asyncio.sleep(10.0)
        here.bus.remove(here.unit)
        here.bus.add(make_unit("ssw07", 1))
        await asyncio.sleep(60.0)

        assert here.fast_events() == ["fast_words_used", "fast_words_changed"]
        assert "refused" in here.events("fast_words_changed")[0].text
        assert list(here.unit.writes) == []


@virtually
async def test_a_map_that_takes_nothing_is_given_up_after_a_few_writings() -> None:
    unit: Any = make_unit("ssw900", 1)
    unit.fixed.update(dict.fromkeys(range(1300, 1350), 7))
    async with one_starter(unit, has_fast_words=True, lap_s=900.0, every_s=60.0) as here:
        await asyncio.sleep(5000.0)

        assert len(here.audits()) == MOST_WRITINGS
        assert here.fast_events()[-1] == "fast_words_unusable"
        assert {audit.decision for audit in here.audits()} == {"unconfirmed"}


@virtually
async def test_no_more_is_written_in_an_hour_than_the_memory_bears() -> None:
    unit = make_unit("ssw900", 1)
    async with one_starter(unit, has_fast_words=True, lap_s=900.0, every_s=60.0) as here:
        here.policy.write_budget.take("pump", MOST_PER_HOUR - 40, now_s=0.0)
        await asyncio.sleep(1800.0)
        assert map_writes(here) == []
        assert here.fast_events() == ["fast_words_waiting"]

        await asyncio.sleep(2000.0)

        assert len(map_writes(here)) == 1
        assert here.fast_events() == ["fast_words_waiting", "fast_words_used"]


@virtually
async def test_words_that_read_nothing_are_not_used() -> None:
    unit: Any = make_unit("ssw900", 1)
    unit.fixed.update(dict.fromkeys(range(1500, 1550), 0))
    async with one_starter(unit, has_fast_words=True) as here:
        await asyncio.sleep(30.0)

        assert here.fast_events() == ["fast_words_unusable"]
        assert asked(here, STATUS) > 20


@virtually
async def test_a_starter_whose_map_is_refused_is_read_as_before() -> None:
    unit: Any = make_unit("ssw900", 1)

    def refuse(registers: range) -> None:
        if registers[0] in MAP:
            raise refuse_address(registers[0])

    unit._map.check_read = refuse
    async with one_starter(unit, has_fast_words=True) as here:
        await asyncio.sleep(30.0)

        assert here.fast_events() == ["fast_words_unusable"]


@virtually
async def test_nothing_is_mapped_under_a_maintenance_lock() -> None:
    async with one_starter(make_unit("ssw900", 1), has_fast_words=True) as here:
        here.submit("lock", "1", reason="fuses")
        await asyncio.sleep(60.0)
        assert map_writes(here) == []

        here.submit("unlock", "2")
        await asyncio.sleep(60.0)

        assert len(map_writes(here)) == 1


@virtually
async def test_nothing_is_mapped_in_another_starter_than_before_until_it_is_accepted() -> None:
    async with one_starter(make_unit("ssw900", 1, serial_number=1), has_fast_words=True) as here:
        await asyncio.sleep(10.0)
        await here.replace(make_unit("ssw900", 1, serial_number=2))
        assert list(here.unit.writes) == []

        here.submit("accept", "1")
        await asyncio.sleep(60.0)

        assert here.sink.final("1").phase is Phase.CONFIRMED
        assert here.events("identity_changed")


@virtually
async def test_a_starter_with_nothing_to_map_is_read_as_before() -> None:
    unit: Any = make_unit("ssw900", 1)
    for register in (*range(100), 680, 685, 686):
        unit._map.owners.pop(register, None)
    async with one_starter(unit, has_fast_words=True) as here:
        await asyncio.sleep(30.0)

        assert here.fast_events() == ["fast_words_unusable"]
        assert list(unit.writes) == []


@virtually
async def test_a_starter_that_goes_silent_meanwhile_is_looked_at_when_it_is_back() -> None:
    async with one_starter(make_unit("ssw900", 1), has_fast_words=True) as here:
        here.unit.motor.start()
        await asyncio.sleep(20.0)
        here.unit.power_off()
        await asyncio.sleep(60.0)
        assert here.fast_events() == []
        here.unit.power_on()
        await asyncio.sleep(60.0)

        assert here.fast_events() == ["fast_words_used"]


@virtually
async def test_a_bug_is_logged_and_ends_nothing_else(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr("gateway.starters.services.mapped_registers.probes", fail)
    async with one_starter(make_unit("ssw900", 1), has_fast_words=True) as here:
        await asyncio.sleep(20.0)

        assert "task=fast words pump ended by a bug" in caplog.text
        assert asked(here, STATUS) > 10
