"""An SSW900 whose RS-485 accessory sits in the other slot than configured: its own word counts for a stop."""

from __future__ import annotations

import asyncio

from gateway.modbus.writes import MaskWriteRegister, WriteRegister
from gateway.records import Severity
from gateway.sim.core.unit import SimulatedUnit
from gateway.sim.factory import make_unit
from tests.starters.one_starter import OneStarter, one_starter
from tests.starters.rig import virtually

WRITES = (5, 6, 15, 16, 22)
WORD_2 = 686


def turning() -> SimulatedUnit:
    """Return a starter with its accessory in slot 2, whose motor is turning."""
    unit = make_unit("ssw900", 1, slot=2)
    unit.handle(WriteRegister(WORD_2, 0x0012).encode(), 0.0)
    unit.handle(WriteRegister(WORD_2, 0x0013).encode(), 0.0)
    return unit


def writes(here: OneStarter) -> list[bytes]:
    return [pdu for pdu in here.requests() if pdu[0] in WRITES]


@virtually
async def test_a_stop_goes_to_the_word_of_the_slot_that_the_starter_proves() -> None:
    async with one_starter(turning(), slot=1) as here:
        await asyncio.sleep(30.0)
        here.submit("stop", "s")
        await asyncio.sleep(30.0)

        assert writes(here) == [WriteRegister(WORD_2, 0x0012).encode()]
        assert not here.unit.motor.is_turning
        assert here.sink.final("s").code == "ok"


@virtually
async def test_so_does_a_stop_of_a_starter_that_has_gone_silent_since() -> None:
    async with one_starter(turning(), slot=1) as here:
        await asyncio.sleep(30.0)
        answer = here.unit.handle
        here.unit.handle = lambda pdu, now_s: answer(pdu, now_s) if pdu[0] in WRITES else None
        await asyncio.sleep(120.0)
        here.submit("stop", "s")
        await asyncio.sleep(30.0)

        assert set(writes(here)) == {MaskWriteRegister(WORD_2, 0xFFFA, 0).encode()}
        assert not here.unit.motor.is_turning


@virtually
async def test_it_is_an_event_once_and_the_advice_follows_the_proof() -> None:
    async with one_starter(make_unit("ssw900", 1, slot=2, settings={229: 0, 230: 4}), slot=1) as here:
        await asyncio.sleep(300.0)

        (event,) = here.events("slot_mismatch")
        assert event.severity is Severity.ERROR
        assert event.data == {"configured": 1, "seen": 2}
        advice = here.events("readiness")[-1].text
        assert "slot = 1 is configured" in advice
        assert "Slot 2)" in advice
        assert "Slot 1)" not in advice.replace("C3.3 = 4 (Slot 1)", "")


@virtually
async def test_a_starter_that_cannot_say_where_its_accessory_sits_is_taken_as_configured() -> None:
    unit = make_unit("ssw900", 1, slot=2)
    unit.fixed = {335: 2, 336: 2}  # type: ignore[attr-defined]
    async with one_starter(unit, slot=2) as here:
        await asyncio.sleep(30.0)
        here.submit("start", "1")
        await asyncio.sleep(30.0)

        assert here.sink.final("1").code == "ok"
