"""An SSW900 whose command word is not known freshly: a stop clears run and jog in it, and nothing else."""

from __future__ import annotations

import asyncio
from itertools import pairwise

import pytest

from gateway.modbus.writes import MaskWriteRegister, WriteRegister
from gateway.sim.core.unit import SimulatedUnit
from gateway.sim.factory import make_unit
from tests.starters.one_starter import OneStarter, one_starter
from tests.starters.rig import virtually

MASKS = [MaskWriteRegister(word, 0xFFFA, 0).encode() for word in (685, 686)]
WRITES = (5, 6, 15, 16, 22)
OPENED_S = 0.001  # the port is open, and nothing has been read
ENABLED, REMOTE = 0x0002, 0x0010


def writes(here: OneStarter) -> list[bytes]:
    return [pdu for pdu in here.requests() if pdu[0] in WRITES]


def written_s(here: OneStarter) -> list[float]:
    return [frame.start_s for frame in here.bus.transcript if frame.sender == 0 and frame.data[1:-2] in MASKS]


def leave_reads_unanswered(unit: SimulatedUnit) -> None:
    answer = unit.handle
    unit.handle = lambda pdu, now_s: answer(pdu, now_s) if pdu[0] in WRITES else None  # type: ignore[method-assign]


def refuse_masks(unit: SimulatedUnit) -> None:
    answer = unit.handle
    unit.handle = lambda pdu, now_s: b"\x96\x01" if pdu[0] == 22 else answer(pdu, now_s)  # type: ignore[method-assign]


@pytest.mark.parametrize(("slot", "masks"), [(1, MASKS[:1]), (2, MASKS[1:]), (None, MASKS)])
@virtually
async def test_a_stop_before_the_first_reading_clears_run_and_jog_in_the_word_of_its_slot(
    slot: int | None, masks: list[bytes]
) -> None:
    async with one_starter(make_unit("ssw900", 1, slot=slot or 1), slot=slot) as here:  # type: ignore[arg-type]
        await asyncio.sleep(OPENED_S)
        here.submit("stop", "s")
        await asyncio.sleep(10.0)

        assert writes(here)[: len(masks)] == masks
        assert here.sink.final("s").code == "ok"


@pytest.mark.parametrize("word", [0, ENABLED, REMOTE, ENABLED | REMOTE])
@virtually
async def test_a_stop_before_the_first_reading_neither_enables_a_starter_nor_makes_it_remote(
    word: int,
) -> None:
    unit = make_unit("ssw900", 1)
    unit.handle(WriteRegister(685, word).encode(), 0.0)
    before = (unit.is_enabled, unit.is_remote)  # type: ignore[attr-defined]
    assert before == (bool(word & ENABLED), bool(word & REMOTE))
    leave_reads_unanswered(unit)
    async with one_starter(unit, slot=1) as here:
        here.submit("stop", "s")
        await asyncio.sleep(15.0)

        assert (here.unit.is_enabled, here.unit.is_remote) == before


@virtually
async def test_a_stop_soon_after_a_reading_writes_the_word_that_was_read() -> None:
    async with one_starter(make_unit("ssw900", 1)) as here:
        await asyncio.sleep(5.0)
        here.submit("start", "1")
        await asyncio.sleep(30.0)
        here.submit("stop", "s")
        await asyncio.sleep(30.0)

        assert writes(here)[-1] == WriteRegister(685, 0x0012).encode()
        assert here.sink.final("s").code == "ok"


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
async def test_a_stop_of_a_starter_that_cannot_be_read_any_more_stops_it_by_mask() -> None:
    async with one_starter(make_unit("ssw900", 1)) as here:
        await asyncio.sleep(5.0)
        here.submit("start", "1")
        await asyncio.sleep(30.0)
        leave_reads_unanswered(here.unit)
        await asyncio.sleep(3.0)
        here.submit("stop", "s")
        await asyncio.sleep(60.0)

        assert set(writes(here)[1:]) == {MASKS[0]}
        assert not here.unit.motor.is_turning
        assert here.sink.phases("s")[-1][0] == "unconfirmed"


@virtually
async def test_a_starter_without_function_22_gets_the_word_read_last_at_once_however_old() -> None:
    async with one_starter(make_unit("ssw900", 1)) as here:
        refuse_masks(here.unit)
        await asyncio.sleep(5.0)
        here.submit("start", "1")
        await asyncio.sleep(30.0)
        leave_reads_unanswered(here.unit)
        await asyncio.sleep(600.0)
        here.bus.transcript.clear()
        asked_s = asyncio.get_running_loop().time()
        here.submit("stop", "s")
        await asyncio.sleep(60.0)

        assert writes(here)[:2] == [MASKS[0], WriteRegister(685, 0x0012).encode()]
        assert MASKS[0] not in writes(here)[1:]
        last_s = next(frame.start_s for frame in here.bus.transcript if frame.data[1:2] == b"\x06")
        assert last_s - asked_s < 0.5
        assert not here.unit.motor.is_turning


@virtually
async def test_the_stop_of_a_starter_without_function_22_that_was_never_read_is_unconfirmed() -> None:
    unit = make_unit("ssw900", 1)
    refuse_masks(unit)
    leave_reads_unanswered(unit)
    async with one_starter(unit, slot=1) as here:
        here.submit("stop", "s")
        await asyncio.sleep(30.0)

        times_s = written_s(here)
        assert set(writes(here)) == {MASKS[0]}
        assert len(times_s) >= 15
        assert max(later - one for one, later in pairwise(times_s)) < 1.0
        reads = [pdu for pdu in here.requests() if pdu[:3] == b"\x03\x02\xa8"]
        assert len(reads) >= 10
        assert here.sink.phases("s")[-1] == ("unconfirmed", "not_seen")
        assert "illegal function" in here.sink.final("s").text
        assert "turning" in here.sink.final("s").text


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
