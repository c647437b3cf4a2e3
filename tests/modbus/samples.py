"""Requests by their function's number, and seeded random requests and replies by the ten thousand."""

from __future__ import annotations

import random
from typing import Any, cast

from gateway.modbus.device_id import ONE_OBJECT_CODE, DeviceIdentification, ReadDeviceIdentification
from gateway.modbus.pdu import encode_exception
from gateway.modbus.reads import ReadCoils, ReadDiscreteInputs, ReadHoldingRegisters, ReadInputRegisters
from gateway.modbus.server import KnownRequest
from gateway.modbus.writes import (
    MaskWriteRegister,
    WriteCoil,
    WriteCoils,
    WriteRegister,
    WriteRegisters,
)

Rng = random.Random
CLASSES: dict[int, Any] = {
    1: ReadCoils,
    2: ReadDiscreteInputs,
    3: ReadHoldingRegisters,
    4: ReadInputRegisters,
    5: WriteCoil,
    6: WriteRegister,
    15: WriteCoils,
    16: WriteRegisters,
    22: MaskWriteRegister,
    43: ReadDeviceIdentification,
}
MOST = {1: 2000, 2: 2000, 3: 125, 4: 125, 15: 1968, 16: 123}  # [APP 6]


def fc(function: int, *arguments: Any) -> KnownRequest:
    """Return the request of this function."""
    return cast(KnownRequest, CLASSES[function](*arguments))


def random_request(rng: Rng, function: int | None = None) -> KnownRequest:
    """Return a request of any function; mostly short, sometimes as long as it may be."""
    number = function or rng.choice(list(CLASSES))
    match number:
        case 1 | 2 | 3 | 4:
            return fc(number, *_run(rng, MOST[number]))
        case 5:
            return fc(number, rng.randrange(0x10000), rng.random() < 0.5)
        case 15:
            start, count = _run(rng, MOST[number])
            return fc(number, start, _bits(rng, count))
        case 16:
            start, count = _run(rng, MOST[number])
            return fc(number, start, _words(rng, count))
        case 43:
            return fc(number, rng.randint(1, 4), rng.randrange(256))
        case _:
            return fc(number, *_words(rng, {6: 2, 22: 3}[number]))


def random_value(rng: Rng, request: KnownRequest) -> Any:
    """Return what a reply to this request may say; None for a write."""
    match request:
        case ReadCoils() | ReadDiscreteInputs():
            return _bits(rng, request.count)
        case ReadHoldingRegisters() | ReadInputRegisters():
            return _words(rng, request.count)
        case ReadDeviceIdentification():
            return _identification(rng, request)
        case _:
            return None


def reply_of(request: Any, value: Any) -> bytes:
    """Return the PDU of the normal reply that says this."""
    pdu: bytes = request.encode_reply() if value is None else request.encode_reply(value)
    return pdu


def random_reply(rng: Rng, request: KnownRequest) -> bytes:
    """Return the PDU of a reply to this request: mostly the normal one, sometimes an exception."""
    if rng.random() < 0.1:
        return encode_exception(request.function, rng.randrange(256))
    return reply_of(request, random_value(rng, request))


def _count(rng: Rng, most: int) -> int:
    return rng.randint(1, most if rng.random() < 0.1 else min(most, 12))


def _words(rng: Rng, count: int) -> tuple[int, ...]:
    return tuple(rng.randrange(0x10000) for _ in range(count))


def _bits(rng: Rng, count: int) -> tuple[bool, ...]:
    return tuple(rng.random() < 0.5 for _ in range(count))


def _run(rng: Rng, most: int) -> tuple[int, int]:
    count = _count(rng, most)
    return rng.choice((0, rng.randint(0, 0x10000 - count), 0x10000 - count)), count


def _identification(rng: Rng, request: ReadDeviceIdentification) -> DeviceIdentification:
    def text() -> str:
        return rng.randbytes(rng.randint(0, 16)).decode("latin-1")

    if request.read_code == ONE_OBJECT_CODE:
        return DeviceIdentification({request.object_id: text()})
    keys = rng.sample(range(256), rng.randint(0, 4))
    return DeviceIdentification({key: text() for key in keys})
