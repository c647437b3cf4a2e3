"""An independent library judges the same frames: pymodbus, given each frame alone and whole.

pymodbus hunts for a frame among garbage and forgives what stands behind one, so "accepted" here means: it
took the bytes from the first to the last as one frame. Where it is laxer by design, the test says so.
"""

from __future__ import annotations

import random
from typing import Any

import pymodbus.pdu.bit_message as bits
import pymodbus.pdu.register_message as registers
import pytest
from pymodbus.framer import FramerRTU
from pymodbus.pdu import DecodePDU, ExceptionResponse, ModbusPDU
from pymodbus.pdu.mei_message import ReadDeviceInformationRequest, ReadDeviceInformationResponse

from gateway.errors import BadFrameError, BadReplyError
from gateway.modbus import adu
from gateway.modbus.adu import crc16
from gateway.modbus.codes import EXCEPTION_BIT, Function
from gateway.modbus.device_id import DeviceIdentification, ReadDeviceIdentification
from gateway.modbus.pdu import exception_code
from gateway.modbus.reads import ReadCoils, ReadDiscreteInputs, ReadHoldingRegisters, ReadInputRegisters
from gateway.modbus.server import KnownRequest, decode_request
from gateway.modbus.writes import (
    MaskWriteRegister,
    WriteCoil,
    WriteCoils,
    WriteRegister,
    WriteRegisters,
)
from tests.modbus.samples import random_reply, random_request

FRAMES_PER_SEED = 8_000
SEEDS = (1, 2)

_CLIENT = FramerRTU(DecodePDU(is_server=False))

_REFUSED = "refused"


def damaged(rng: random.Random, frame: bytes) -> bytes:
    """Return the frame, one time in three intact; the last kinds of damage are given a right CRC again."""
    if rng.random() < 1 / 3:
        return frame
    at = rng.randrange(len(frame))
    match rng.randrange(8):
        case 0:  # one bit
            return frame[:at] + bytes((frame[at] ^ 1 << rng.randrange(8),)) + frame[at + 1 :]
        case 1:  # cut off
            return frame[:at]
        case 2:  # a byte lost
            return frame[:at] + frame[at + 1 :]
        case 3:  # more behind it
            return frame + rng.randbytes(rng.randint(1, 5))
        case 4:  # CRC high byte first
            return frame[:-2] + frame[:-3:-1]
        case 5:  # noise
            return rng.randbytes(rng.randint(0, 12))
        case 6:  # a byte changed before the CRC was made
            return sealed(frame[:at] + rng.randbytes(1) + frame[at + 1 : -2])
        case _:  # lost bytes or more of them before the CRC was made
            return sealed(frame[: max(2, at)] + rng.randbytes(rng.randint(0, 3)))


def sealed(body: bytes) -> bytes:
    return body + crc16(body).to_bytes(2, "little")


def ours_whole(frame: bytes) -> tuple[int, bytes] | None:
    """Return unit and PDU when we take the bytes for one whole reply."""
    try:
        unit, pdu = adu.decode(frame)
        is_whole = adu.reply_adu_size(frame) == len(frame)
    except BadFrameError:
        return None
    return (unit, pdu) if is_whole else None


def theirs_whole(framer: FramerRTU, frame: bytes) -> tuple[int, bytes] | None:
    """Return unit and PDU when pymodbus takes the bytes, all of them, for one frame."""
    used, unit, _, pdu = framer.decode(frame)
    return (unit, pdu) if used == len(frame) == len(pdu) + 3 else None


def ours_meaning(request: KnownRequest, pdu: bytes) -> Any:
    """Return what we read in a reply: ("exception", code), the value, or refused."""
    code = exception_code(request, pdu)
    if code is not None:
        return ("exception", code)
    try:
        return request.decode_reply(pdu)
    except BadReplyError:
        return _REFUSED


def theirs_meaning(request: KnownRequest, frame: bytes) -> Any:
    """Return the same as pymodbus reads it.

    pymodbus leaves it to its user whether a reply answers the request, and reads on over an odd byte count or
    a coil that is neither on nor off; so its reply is held against the request, and must encode to what came.
    """
    _, reply = _CLIENT.handleFrame(frame, 0, 0)
    assert reply is not None
    if isinstance(reply, ExceptionResponse):
        is_ours = reply.function_code == request.function | EXCEPTION_BIT
        return ("exception", reply.exception_code) if is_ours else _REFUSED
    if reply.function_code != request.function:
        return _REFUSED
    if isinstance(reply, ReadDeviceInformationResponse):
        return identification(request, reply)
    said: bytes = reply.encode()
    match request:
        case _ if said != frame[2:-2]:
            return _REFUSED
        case ReadCoils() | ReadDiscreteInputs():
            is_right = len(reply.bits) == (request.count + 7) // 8 * 8
            return tuple(reply.bits[: request.count]) if is_right else _REFUSED
        case ReadHoldingRegisters() | ReadInputRegisters():
            return tuple(reply.registers) if len(reply.registers) == request.count else _REFUSED
        case _:  # a write is acknowledged by its own beginning: address, and value, masks or count [APP 6]
            return None if theirs_of(request, 1).encode().startswith(said) else _REFUSED


def identification(request: KnownRequest, reply: ReadDeviceInformationResponse) -> Any:
    """Return the objects as we name them; of an object that comes twice we keep the last, pymodbus all."""
    assert isinstance(request, ReadDeviceIdentification)
    if reply.read_code != request.read_code:
        return _REFUSED
    last = {key: said[-1] if isinstance(said, list) else said for key, said in reply.information.items()}
    return DeviceIdentification({key: said.decode("latin-1") for key, said in last.items()})


def is_beyond_comparison(frame: bytes) -> bool:
    """Whether pymodbus takes what we refuse by design: another function than ours, or a reply from unit 0."""
    return frame[0] == adu.BROADCAST or frame[1] & ~EXCEPTION_BIT not in set(Function)


@pytest.mark.parametrize("seed", SEEDS)
def test_of_thousands_of_frames_both_accept_the_same_and_read_the_same(seed: int) -> None:
    rng = random.Random(seed)
    accepted = refused = understood = laxer = 0

    for _ in range(FRAMES_PER_SEED):
        request = random_request(rng)
        # sometimes another request of the same function, whose late reply might be taken for this one's
        answered = random_request(rng, request.function) if rng.random() < 0.1 else request
        frame = damaged(rng, adu.encode(rng.randint(1, 247), random_reply(rng, answered)))
        theirs = theirs_whole(_CLIENT, frame)
        ours = ours_whole(frame)
        if theirs is not None and is_beyond_comparison(frame):
            assert ours is None, frame.hex(" ")
            laxer += 1
            continue
        assert ours == theirs, frame.hex(" ")
        if ours is None:
            refused += 1
            continue
        accepted += 1
        meaning = ours_meaning(request, ours[1])
        assert meaning == theirs_meaning(request, frame), (request, frame.hex(" "))
        understood += meaning != _REFUSED

    assert accepted > 2_800  # no side may win by refusing all, or by accepting all
    assert refused > 3_200
    assert understood > 2_300
    assert accepted - understood > 250  # answers to something else
    assert 0 < laxer < 100


THEIRS: dict[type, tuple[type[ModbusPDU], tuple[str, ...]]] = {  # their class, and how it calls our fields
    ReadCoils: (bits.ReadCoilsRequest, ("address", "count")),
    ReadDiscreteInputs: (bits.ReadDiscreteInputsRequest, ("address", "count")),
    ReadHoldingRegisters: (registers.ReadHoldingRegistersRequest, ("address", "count")),
    ReadInputRegisters: (registers.ReadInputRegistersRequest, ("address", "count")),
    WriteCoil: (bits.WriteSingleCoilRequest, ("address", "bits")),
    WriteRegister: (registers.WriteSingleRegisterRequest, ("address", "registers")),
    WriteCoils: (bits.WriteMultipleCoilsRequest, ("address", "bits")),
    WriteRegisters: (registers.WriteMultipleRegistersRequest, ("address", "registers")),
    MaskWriteRegister: (registers.MaskWriteRegisterRequest, ("address", "and_mask", "or_mask")),
    ReadDeviceIdentification: (ReadDeviceInformationRequest, ("read_code", "object_id")),
}


def theirs_of(request: KnownRequest, unit: int) -> ModbusPDU:
    """Return the same request as pymodbus makes it."""
    their, names = THEIRS[type(request)]
    values = [getattr(request, name) for name in request.__match_args__]
    fields: dict[str, Any] = dict(zip(names, values, strict=True))
    for name in {"bits", "registers"} & set(fields):
        fields[name] = list(fields[name]) if isinstance(fields[name], tuple) else [fields[name]]
    return their(**fields, dev_id=unit)


def test_both_make_the_same_bytes_of_a_request() -> None:
    rng = random.Random(5)

    for _ in range(2_000):
        request, unit = random_request(rng), rng.randint(0, 247)
        theirs = _CLIENT.buildFrame(theirs_of(request, unit))

        assert adu.encode(unit, request.encode()) == theirs
        assert decode_request(adu.decode(theirs).pdu) == request
