"""Seeded random requests and replies, for comparisons by the ten thousand."""

from __future__ import annotations

import random
from collections.abc import Callable

from gateway.modbus.device_id import ONE_OBJECT_CODE, DeviceIdentification, ReadDeviceIdentification
from gateway.modbus.pdu import encode_exception
from gateway.modbus.reads import ReadCoils, ReadDiscreteInputs, ReadHoldingRegisters, ReadInputRegisters
from gateway.modbus.server import KnownRequest
from gateway.modbus.writes import (
    MaskWriteRegister,
    ReadWriteRegisters,
    WriteCoil,
    WriteCoils,
    WriteRegister,
    WriteRegisters,
)

Rng = random.Random


def random_request(rng: Rng) -> KnownRequest:
    """Return a request of any function; mostly short, sometimes as long as it may be."""
    return rng.choice(_MAKERS)(rng)


def random_sibling(rng: Rng, request: KnownRequest) -> KnownRequest:
    """Return another request of the same function, whose late reply might be taken for this one's."""
    while not isinstance(sibling := random_request(rng), type(request)):
        pass
    return sibling


def random_reply(rng: Rng, request: KnownRequest) -> bytes:
    """Return the PDU of a reply to this request: mostly the normal one, sometimes an exception."""
    if rng.random() < 0.1:
        return encode_exception(request.function, rng.randrange(256))
    match request:
        case ReadCoils() | ReadDiscreteInputs():
            return request.encode_reply(_bits(rng, request.count))
        case ReadHoldingRegisters() | ReadInputRegisters():
            return request.encode_reply(_words(rng, request.count))
        case ReadWriteRegisters():
            return request.encode_reply(_words(rng, request.read_count))
        case ReadDeviceIdentification():
            return request.encode_reply(_identification(rng, request))
        case _:
            return request.encode_reply()


def _count(rng: Rng, most: int) -> int:
    return rng.randint(1, most if rng.random() < 0.1 else min(most, 12))


def _start(rng: Rng, count: int) -> int:
    return rng.randint(0, 0x10000 - count)


def _words(rng: Rng, count: int) -> tuple[int, ...]:
    return tuple(rng.randrange(0x10000) for _ in range(count))


def _bits(rng: Rng, count: int) -> tuple[bool, ...]:
    return tuple(rng.random() < 0.5 for _ in range(count))


def _identification(rng: Rng, request: ReadDeviceIdentification) -> DeviceIdentification:
    def text() -> str:
        return rng.randbytes(rng.randint(0, 16)).decode("latin-1")

    if request.read_code == ONE_OBJECT_CODE:
        return DeviceIdentification(objects={request.object_id: text()})
    keys = rng.sample(range(256), rng.randint(0, 4))
    return DeviceIdentification({key: text() for key in keys}, rng.random() < 0.3, rng.randrange(256))


def _run(rng: Rng, most: int) -> tuple[int, int]:
    count = _count(rng, most)
    return _start(rng, count), count


def _write_coils(rng: Rng) -> KnownRequest:
    start, count = _run(rng, 1968)
    return WriteCoils(start, _bits(rng, count))


def _write_registers(rng: Rng) -> KnownRequest:
    start, count = _run(rng, 123)
    return WriteRegisters(start, _words(rng, count))


def _read_write(rng: Rng) -> KnownRequest:
    start, count = _run(rng, 121)
    return ReadWriteRegisters(*_run(rng, 125), start, _words(rng, count))


_MAKERS: tuple[Callable[[Rng], KnownRequest], ...] = (
    lambda rng: ReadCoils(*_run(rng, 2000)),
    lambda rng: ReadDiscreteInputs(*_run(rng, 2000)),
    lambda rng: ReadHoldingRegisters(*_run(rng, 125)),
    lambda rng: ReadInputRegisters(*_run(rng, 125)),
    lambda rng: WriteCoil(rng.randrange(0x10000), rng.random() < 0.5),
    lambda rng: WriteRegister(*_words(rng, 2)),
    _write_coils,
    _write_registers,
    lambda rng: MaskWriteRegister(*_words(rng, 3)),
    _read_write,
    lambda rng: ReadDeviceIdentification(rng.randint(1, 4), rng.randrange(256)),
)
