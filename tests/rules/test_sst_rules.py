"""Rules of the SST (ST-xx) that need a line or whole frames."""

from __future__ import annotations

import asyncio

import pytest

from gateway.modbus.adu import encode
from gateway.modbus.pdu import Request
from gateway.modbus.reads import ReadCoils, ReadInputRegisters
from gateway.modbus.timing import Framing, LineTiming
from gateway.modbus.writes import WriteCoil, WriteRegister
from gateway.sim.bus.port import SimulatedLine
from gateway.sim.factory import make_unit
from tests.sim.wire import Talk, receive
from tests.virtual_time import run_virtually

TIMING = LineTiming(9600, Framing.parse("8N2"))
READ = encode(1, ReadInputRegisters(0, 2).encode())


def answer(frame: bytes, *, gap_characters: float = 0.0) -> bytes:
    """Return what an SST answers to a frame with a pause behind its fourth byte."""

    async def main() -> bytes:
        port = await SimulatedLine(TIMING, [make_unit("sst", 1)]).opener()()
        port.write(frame[:4])
        await asyncio.sleep(TIMING.wire_s(4) + gap_characters * TIMING.character_s)
        port.write(frame[4:])
        return await receive(port, within_s=0.3)

    return run_virtually(main())


def test_st_03_a_gap_of_more_than_one_and_a_half_characters_makes_a_frame_incomplete() -> None:
    assert len(answer(READ, gap_characters=1.4)) == 9
    assert answer(READ, gap_characters=1.6) == b""


def test_st_03_the_answer_comes_after_a_silence_of_three_and_a_half_characters() -> None:
    async def main() -> None:
        port = await SimulatedLine(TIMING, [make_unit("sst", 1)], chunk_bytes=None).opener()()
        port.write(READ)
        reply = await port.read(until_s=1.0)
        assert port.last_byte_s - TIMING.wire_s(len(READ) + len(reply)) >= TIMING.silence_s

    run_virtually(main())


@pytest.mark.parametrize("frame", [READ[:-1] + bytes((READ[-1] ^ 1,)), READ[:-1], READ[1:]])
def test_st_04_a_corrupt_or_incomplete_message_gets_no_answer(frame: bytes) -> None:
    assert answer(frame) == b""


@pytest.mark.parametrize(
    ("request_", "reply"),
    [
        (WriteCoil(2, is_on=True), "050002ff00"),
        (ReadCoils(4, 1), "010101"),
        (ReadInputRegisters(41, 1), "04020000"),
        (WriteRegister(0, 1), "8602"),
    ],
)
def test_st_26_a_request_is_answered_filled_in_and_an_error_with_80h_and_its_code(
    request_: Request, reply: str
) -> None:
    assert (Talk(make_unit("sst", 1)).pdu(request_) or b"").hex() == reply
