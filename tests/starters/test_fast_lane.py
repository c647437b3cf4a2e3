"""The fast words of an SSW900: written at standstill only, proved by every reply, left when they change."""

from __future__ import annotations

import asyncio
import random
from typing import Any

import pytest

from gateway.modbus.adu import decode
from gateway.sim.answers import refuse_address
from gateway.sim.factory import make_unit
from gateway.sim.impair import Reply
from gateway.starters.fast_lane import MOST_WRITINGS
from gateway.starters.records import Phase, Quality, Severity, ValueRecord
from gateway.starters.wear import MOST_PER_HOUR
from tests.starters.one_starter import Here, one_starter
from tests.starters.rig import virtually

MAP = range(1300, 1350)
STATUS, VALUES = bytes.fromhex("03 02A8"), bytes.fromhex("03 0002")
FAST = bytes.fromhex("03 05DC")


def map_of(here: Here) -> list[int]:
    return [here.unit.setting(register) for register in MAP]


def map_writes(here: Here) -> list[bytes]:
    """Return the writes that reached the map."""
    return [w.pdu for w in here.unit.writes if 1300 <= int.from_bytes(w.pdu[1:3], "big") < 1350]


def asked(here: Here, start: bytes) -> int:
    return sum(pdu.startswith(start) for pdu in here.requests())


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
        assert here.precautions.wear.total("pump") == 46
    unit._write_registers(1304, [0, 0])
    unit.writes.clear()

    async with one_starter(unit, has_fast_words=True) as here:
        await asyncio.sleep(10.0)

        assert map_writes(here) == [bytes.fromhex("10 0518 0002 04 005E 005F")]
        assert here.precautions.wear.total("pump") == 2
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


@pytest.mark.parametrize("place", [0, 13, 21, 30])
@virtually
async def test_a_map_that_somebody_changes_is_left_at_once_and_no_wrong_value_is_told(place: int) -> None:
    async with one_starter(make_unit("ssw900", 1), has_fast_words=True) as here:
        await asyncio.sleep(10.0)
        told = {name: reading.value for name, reading in here.telemetry.snapshot.readings.items()}
        here.sink.clear()
        here.bus.transcript.clear()

        here.unit._write_registers(1300 + place, [402])
        await asyncio.sleep(60.0)

        (event,) = here.events("fast_words_changed")
        assert event.severity is Severity.WARNING
        good = [r for r in here.sink.of(ValueRecord) if r.quality is Quality.GOOD]
        assert {r.point: r.value for r in good if told[r.point] == 0} == {
            r.point: told[r.point] for r in good if told[r.point] == 0
        }
        assert [r for r in here.sink.of(ValueRecord) if r.quality is not Quality.GOOD] == []
        assert asked(here, FAST) <= 2
        assert asked(here, STATUS) > 50
        assert len(map_writes(here)) == 1  # ours: it is not fought over


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
        here.precautions.wear.take("pump", MOST_PER_HOUR - 40, now_s=0.0)
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
async def test_the_keypad_watch_does_not_take_our_map_for_somebody_elses() -> None:
    async with one_starter(make_unit("ssw900", 1), has_fast_words=True, lap_s=0.2) as here:
        here.unit.motor.start()
        await asyncio.sleep(60.0)
        here.submit("stop", "1")
        await asyncio.sleep(120.0)

        assert len(map_writes(here)) == 1
        assert here.events("parameter_changed") == []


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

    monkeypatch.setattr("gateway.starters.fast_lane.probes", fail)
    async with one_starter(make_unit("ssw900", 1), has_fast_words=True) as here:
        await asyncio.sleep(20.0)

        assert "fast words ended by a bug" in caplog.text
        assert asked(here, STATUS) > 10
