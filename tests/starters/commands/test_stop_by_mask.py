"""An SSW900 whose command word is not known freshly: a stop clears run and jog in it, and nothing else."""

from __future__ import annotations

import asyncio

from gateway.modbus.writes import MaskWriteRegister, WriteRegister
from gateway.sim.core.unit import SimulatedUnit
from gateway.sim.factory import make_unit
from tests.starters.one_starter import OneStarter, one_starter
from tests.starters.rig import virtually

MASKS = [MaskWriteRegister(word, 0xFFFA, 0).encode() for word in (685, 686)]
WRITES = (5, 6, 15, 16, 22)
OPENED_S = 0.001  # the port is open, and nothing has been read


def writes(here: OneStarter) -> list[bytes]:
    return [pdu for pdu in here.requests() if pdu[0] in WRITES]


def refuse_masks(unit: SimulatedUnit) -> None:
    answer = unit.handle
    unit.handle = lambda pdu, now_s: b"\x96\x01" if pdu[0] == 22 else answer(pdu, now_s)  # type: ignore[method-assign]


@virtually
async def test_a_status_without_the_word_is_not_enough_to_write_the_word() -> None:
    unit = make_unit("ssw900", 1)
    answer, lost = unit.handle, [True]

    def handle(pdu: bytes, now_s: float) -> bytes | None:
        if pdu[0] in WRITES:
            return None if lost and lost.pop() else answer(pdu, now_s)
        return answer(pdu, now_s) if pdu == b"\x03\x02\xa8\x00\x01" else None

    unit.handle = handle  # type: ignore[method-assign]
    async with one_starter(unit, slot=1) as here:
        await asyncio.sleep(OPENED_S)
        here.submit("stop", "s")
        await asyncio.sleep(15.0)

        assert len(writes(here)) > 1
        assert set(writes(here)) == {MASKS[0]}
        assert here.sink.final("s").code == "ok"


@virtually
async def test_a_starter_without_function_22_is_stopped_by_the_first_reading_after_it() -> None:
    unit = make_unit("ssw900", 1)
    unit.handle(WriteRegister(685, 0x0013).encode(), 0.0)
    refuse_masks(unit)
    async with one_starter(unit, slot=1) as here:
        await asyncio.sleep(OPENED_S)
        here.submit("stop", "s")
        await asyncio.sleep(60.0)

        assert writes(here)[0] == MASKS[0]
        assert writes(here)[-1] == WriteRegister(685, 0x0012).encode()
        assert not here.unit.motor.is_turning
        assert here.sink.final("s").code == "ok"
