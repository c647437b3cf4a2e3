"""The fast words of an SSW900: written at standstill only, proved by every reply, left when they change."""

from __future__ import annotations

import asyncio
import logging
import random
from typing import Any

import pytest

from gateway.modbus.adu import decode
from gateway.records import Phase, Quality
from gateway.sim.bus.faults import Reply
from gateway.sim.factory import make_unit
from gateway.starters.services.mapped_registers import MOST_WRITINGS
from tests.starters.mapped import FAST, MAP, STATUS, VALUES, asked, map_writes
from tests.starters.one_starter import OneStarter, one_starter
from tests.starters.rig import virtually


def map_of(here: OneStarter) -> list[int]:
    return [here.unit.setting(register) for register in MAP]


@virtually
async def test_one_request_reads_all_once_the_points_are_mapped() -> None:
    async with one_starter(make_unit("ssw900", 1), has_fast_words=True) as here:
        await asyncio.sleep(10.0)
        here.bus.transcript.clear()
        await asyncio.sleep(20.0)

        assert here.fast_events() == ["fast_words_used"]
        assert len(map_writes(here)) == 1
        assert asked(here, FAST) == pytest.approx(20, abs=1)
        assert asked(here, STATUS) == asked(here, VALUES) == 0


@virtually
async def test_what_becomes_of_mapped_words_is_logged_by_its_event_alone(
    caplog: pytest.LogCaptureFixture,
) -> None:
    with caplog.at_level(logging.INFO, logger="gateway.starters.services"):
        async with one_starter(make_unit("ssw900", 1), has_fast_words=True) as here:
            await asyncio.sleep(10.0)

            assert here.fast_events() == ["fast_words_used"]
    assert "mapped words" not in caplog.text


@virtually
async def test_values_read_by_fast_words_are_those_of_the_starter() -> None:
    async with one_starter(make_unit("ssw900", 1), has_fast_words=True) as here:
        await asyncio.sleep(10.0)
        here.submit("start", "1")
        await asyncio.sleep(60.0)

        assert here.sink.final("1").phase is Phase.CONFIRMED
        readings = here.telemetry.snapshot.readings
        assert readings["running"].value is True
        fast = {name: reading.value for name, reading in readings.items()}
        here.telemetry.use_fast_words(None)
        await asyncio.sleep(5.0)
        plain = here.telemetry.snapshot.readings
        assert plain["current"].value == pytest.approx(fast["current"], rel=0.02)
        assert plain["line_voltage"].value == pytest.approx(fast["line_voltage"], rel=0.02)
        assert {reading.quality for reading in plain.values()} == {Quality.GOOD}


@virtually
async def test_nothing_is_mapped_without_the_switch() -> None:
    async with one_starter(make_unit("ssw900", 1)) as here:
        await asyncio.sleep(60.0)

        assert list(here.unit.writes) == []
        assert here.fast_events() == []


@virtually
async def test_a_gateway_without_operators_writes_no_map_but_uses_one_that_stands() -> None:
    unit: Any = make_unit("ssw900", 1)
    async with one_starter(unit, has_fast_words=True, may_write=False) as here:
        await asyncio.sleep(30.0)
        assert here.fast_events() == ["fast_words_unmapped"]
        assert list(here.unit.writes) == []

    async with one_starter(unit, has_fast_words=True) as here:
        await asyncio.sleep(10.0)
        assert len(map_writes(here)) == 1

    async with one_starter(unit, has_fast_words=True, may_write=False) as here:
        await asyncio.sleep(10.0)
        assert here.fast_events() == ["fast_words_used"]


@virtually
async def test_the_map_of_a_turning_motor_waits_for_standstill() -> None:
    async with one_starter(make_unit("ssw900", 1), has_fast_words=True) as here:
        here.unit.motor.start()
        await asyncio.sleep(60.0)
        assert map_writes(here) == []
        here.bus.transcript.clear()
        await asyncio.sleep(30.0)
        assert asked(here, bytes.fromhex("03 0514")) == 0  # nor is the map asked for again and again

        here.submit("stop", "1")
        await asyncio.sleep(60.0)

        assert len(map_writes(here)) == 1
        assert here.fast_events() == ["fast_words_used"]


@virtually
async def test_only_what_differs_is_written_and_counted_as_wear() -> None:
    unit: Any = make_unit("ssw900", 1)
    async with one_starter(unit, has_fast_words=True) as here:
        await asyncio.sleep(10.0)
        assert here.policy.write_budget.total("pump") == 46
    unit._write_registers(1304, [0, 0])
    unit.writes.clear()

    async with one_starter(unit, has_fast_words=True) as here:
        await asyncio.sleep(10.0)

        assert map_writes(here) == [bytes.fromhex("10 0518 0002 04 005E 005F")]
        assert here.policy.write_budget.total("pump") == 2
        (audit,) = here.audits()
        assert (audit.client, audit.decision) == ("gateway", "confirmed")
        assert audit.args == {"C8.1.1.9": 94, "C8.1.1.10": 95}
        assert audit.before == {"C8.1.1.9": [0], "C8.1.1.10": [0]}


@virtually
async def test_a_map_that_stands_is_not_written_again_after_a_silence() -> None:
    async with one_starter(make_unit("ssw900", 1), has_fast_words=True) as here:
        await asyncio.sleep(10.0)
        here.unit.power_off()
        await asyncio.sleep(30.0)
        here.unit.power_on()
        await asyncio.sleep(60.0)
        here.bus.transcript.clear()
        await asyncio.sleep(10.0)

        assert len(map_writes(here)) == 1
        assert asked(here, FAST) >= 9


@virtually
async def test_a_map_that_was_changed_and_is_ours_again_is_used_after_the_next_silence() -> None:
    async with one_starter(make_unit("ssw900", 1), has_fast_words=True) as here:
        await asyncio.sleep(10.0)
        here.unit._write_registers(1303, [402])
        await asyncio.sleep(10.0)
        here.unit.power_off()
        await asyncio.sleep(30.0)
        here.unit.power_on()
        await asyncio.sleep(60.0)
        assert here.fast_events() == ["fast_words_used", "fast_words_changed"]
        here.unit.power_off()
        here.unit._write_registers(1303, [93])
        await asyncio.sleep(30.0)
        here.unit.power_on()
        await asyncio.sleep(60.0)

        assert here.fast_events() == ["fast_words_used", "fast_words_changed", "fast_words_used"]


@virtually
async def test_a_row_that_this_starter_lacks_is_not_mapped_but_read_as_before() -> None:
    unit: Any = make_unit("ssw900", 1)
    del unit._map.owners[9]  # S1.7.1
    async with one_starter(unit, has_fast_words=True) as here:
        await asyncio.sleep(20.0)

        assert here.fast_events() == ["fast_words_used"]
        assert 9 not in map_of(here)


class Deaf:
    """An impairment: the map takes nothing, or the mapped words are silent, until healed."""

    def __init__(self, *functions: int) -> None:
        self.functions = functions

    def apply(self, reply: Reply, dice: random.Random) -> tuple[Reply, ...]:
        return () if decode(reply.adu).pdu[0] in self.functions else (reply,)


@virtually
async def test_a_lost_answer_only_costs_time() -> None:
    async with one_starter(make_unit("ssw900", 1), has_fast_words=True) as here:
        here.bus.impair(1, Deaf(3), chance=0.3)
        await asyncio.sleep(120.0)
        here.bus.heal(1)
        await asyncio.sleep(120.0)

        assert here.fast_events() == ["fast_words_used"]
        assert len(map_writes(here)) <= MOST_WRITINGS


@virtually
async def test_a_map_whose_writing_was_not_answered_is_read_and_found_to_stand() -> None:
    async with one_starter(make_unit("ssw900", 1), has_fast_words=True) as here:
        here.bus.impair(1, Deaf(16))
        await asyncio.sleep(60.0)

        assert len(map_writes(here)) == 1
        assert here.fast_events() == ["fast_words_used"]


@virtually
async def test_the_keypad_watch_does_not_take_our_map_for_somebody_elses() -> None:
    async with one_starter(make_unit("ssw900", 1), has_fast_words=True, lap_s=0.2) as here:
        here.unit.motor.start()
        await asyncio.sleep(60.0)
        here.submit("stop", "1")
        await asyncio.sleep(120.0)

        assert len(map_writes(here)) == 1
        assert here.events("parameter_changed") == []
