"""Requests as a unit sees them: from a PDU to a request, or to the exception that answers it."""

from __future__ import annotations

import struct
from collections.abc import Callable

from gateway.errors import BadRequestError
from gateway.modbus.codes import MEI_DEVICE_IDENTIFICATION, ExceptionCode, Function
from gateway.modbus.device_id import ONE_OBJECT_CODE, STREAM_CODES, ReadDeviceIdentification
from gateway.modbus.pdu import ADDRESS_SPACE, byte_count, unpack_bits
from gateway.modbus.reads import ReadCoils, ReadDiscreteInputs, ReadHoldingRegisters, ReadInputRegisters
from gateway.modbus.writes import (
    COIL_OFF,
    COIL_ON,
    MaskWriteRegister,
    WriteCoil,
    WriteCoils,
    WriteRegister,
    WriteRegisters,
)

KnownRequest = (
    ReadCoils
    | ReadDiscreteInputs
    | ReadHoldingRegisters
    | ReadInputRegisters
    | WriteCoil
    | WriteRegister
    | WriteCoils
    | WriteRegisters
    | MaskWriteRegister
    | ReadDeviceIdentification
)


def decode_request(pdu: bytes) -> KnownRequest:
    """Return the request that a PDU holds; BadRequestError carries the exception code a unit answers.

    Checked in the specification's order: function (1), quantity and length (3), address (2) [APP 6.1-6.21].
    """
    decode = _DECODERS.get(pdu[0]) if pdu else None
    if decode is None:
        raise BadRequestError(f"no such function: {pdu[:1].hex()}", ExceptionCode.ILLEGAL_FUNCTION)
    return decode(pdu)


def _read(
    kind: type[ReadCoils] | type[ReadDiscreteInputs] | type[ReadHoldingRegisters] | type[ReadInputRegisters],
) -> Callable[[bytes], KnownRequest]:
    def decode(pdu: bytes) -> KnownRequest:
        _require_size(pdu, 5)
        address, count = struct.unpack_from(">HH", pdu, 1)
        _require_run(address, count, max_count=kind.max_count)
        return kind(address, count)

    return decode


def _write_coil(pdu: bytes) -> KnownRequest:
    _require_size(pdu, 5)
    address, value = struct.unpack_from(">HH", pdu, 1)
    _require(value in (COIL_ON, COIL_OFF), f"coil value {value:04X}")
    return WriteCoil(address, value == COIL_ON)


def _write_register(pdu: bytes) -> KnownRequest:
    _require_size(pdu, 5)
    address, word = struct.unpack_from(">HH", pdu, 1)
    return WriteRegister(address, word)


def _write_coils(pdu: bytes) -> KnownRequest:
    _require(len(pdu) >= 6, "too short")
    address, count, size = struct.unpack_from(">HHB", pdu, 1)
    _require(size == byte_count(count), "byte count and quantity differ")
    _require_size(pdu, 6 + size)
    _require_run(address, count, max_count=WriteCoils.max_count)
    return WriteCoils(address, unpack_bits(pdu[6:], count))


def _write_registers(pdu: bytes) -> KnownRequest:
    _require(len(pdu) >= 6, "too short")
    address, count, size = struct.unpack_from(">HHB", pdu, 1)
    _require(size == 2 * count, "byte count and quantity differ")
    _require_size(pdu, 6 + size)
    _require_run(address, count, max_count=WriteRegisters.max_count)
    return WriteRegisters(address, struct.unpack_from(f">{count}H", pdu, 6))


def _mask_write_register(pdu: bytes) -> KnownRequest:
    _require_size(pdu, 7)
    return MaskWriteRegister(*struct.unpack_from(">HHH", pdu, 1))


def _encapsulated(pdu: bytes) -> KnownRequest:
    # Another interface than 14 is a function this unit does not have [APP 6.21].
    if pdu[1:2] != bytes((MEI_DEVICE_IDENTIFICATION,)):
        raise BadRequestError("not MEI type 14", ExceptionCode.ILLEGAL_FUNCTION)
    _require_size(pdu, 4)
    _require(pdu[2] in (*STREAM_CODES, ONE_OBJECT_CODE), f"read code {pdu[2]}")
    return ReadDeviceIdentification(read_code=pdu[2], object_id=pdu[3])


_DECODERS: dict[int, Callable[[bytes], KnownRequest]] = {
    Function.READ_COILS: _read(ReadCoils),
    Function.READ_DISCRETE_INPUTS: _read(ReadDiscreteInputs),
    Function.READ_HOLDING_REGISTERS: _read(ReadHoldingRegisters),
    Function.READ_INPUT_REGISTERS: _read(ReadInputRegisters),
    Function.WRITE_COIL: _write_coil,
    Function.WRITE_REGISTER: _write_register,
    Function.WRITE_COILS: _write_coils,
    Function.WRITE_REGISTERS: _write_registers,
    Function.MASK_WRITE_REGISTER: _mask_write_register,
    Function.ENCAPSULATED: _encapsulated,
}


def _require(is_right: bool, otherwise: str) -> None:  # noqa: FBT001 (a condition, as in an assertion)
    if not is_right:
        raise BadRequestError(otherwise, ExceptionCode.ILLEGAL_DATA_VALUE)


def _require_size(pdu: bytes, size: int) -> None:
    _require(len(pdu) == size, f"{len(pdu)} bytes instead of {size}")


def _require_run(address: int, count: int, *, max_count: int) -> None:
    _require(1 <= count <= max_count, f"quantity {count} is not in 1..{max_count}")
    if address + count > ADDRESS_SPACE:
        raise BadRequestError("addresses beyond 65535", ExceptionCode.ILLEGAL_DATA_ADDRESS)
