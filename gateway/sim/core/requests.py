"""Requests by their kind: what a simulated unit reads and writes for each function, or the exception."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from gateway.errors import BadRequestError
from gateway.modbus import (
    ONE_OBJECT_CODE,
    DeviceIdentification,
    ExceptionCode,
    KnownRequest,
    MaskWriteRegister,
    ReadCoils,
    ReadDeviceIdentification,
    ReadDiscreteInputs,
    ReadHoldingRegisters,
    ReadInputRegisters,
    WriteCoil,
    WriteCoils,
    WriteRegister,
    WriteRegisters,
)


class RequestHandlers:
    """Tables without a row; a family fills them. Refusals are BadRequestErrors with their exception code."""

    conformity: ClassVar[int] = 0x81  # basic identification, stream and one object [APP 6.21]

    def answer(self, request: KnownRequest) -> bytes:
        """Do what is asked and return the reply PDU; BadRequestError when it is refused."""
        match request:
            case ReadCoils():
                return request.encode_reply(self._read_coils(request.address, request.count))
            case ReadDiscreteInputs():
                return request.encode_reply(self._read_discrete_inputs(request.address, request.count))
            case ReadHoldingRegisters() | ReadInputRegisters():  # no family has both
                return request.encode_reply(self._read_registers(request.address, request.count))
            case WriteCoil():
                self._write_coils(request.address, (request.is_on,))
            case WriteCoils():
                self._write_coils(request.address, request.bits)
            case WriteRegister():
                self._write_registers(request.address, (request.word,))
            case WriteRegisters():
                self._write_registers(request.address, request.words)
            case MaskWriteRegister():
                (word,) = self._read_registers(request.address, 1)
                self._write_registers(request.address, (request.apply(word),))
            case ReadDeviceIdentification():
                return self._identify(request)
        return request.encode_reply()

    def _identify(self, request: ReadDeviceIdentification) -> bytes:
        """Answer 43/14 as the SSW-06/07 do: read codes 1 and 4, three objects (ssw06-es 5.4.7)."""
        objects = self._identification()
        if request.read_code == ONE_OBJECT_CODE:
            if request.object_id not in objects:
                raise BadRequestError("no such object", ExceptionCode.ILLEGAL_DATA_ADDRESS)
            objects = {request.object_id: objects[request.object_id]}
        elif request.read_code != 1:
            raise BadRequestError(f"read code {request.read_code}", ExceptionCode.ILLEGAL_DATA_VALUE)
        else:  # a stream from an object that does not exist begins with the first one [APP 6.21]
            start = request.object_id if request.object_id in objects else 0
            objects = {key: text for key, text in objects.items() if key >= start}
        return request.encode_reply(DeviceIdentification(objects), conformity=self.conformity)

    def _read_coils(self, address: int, count: int) -> Sequence[bool]:
        raise _no_address(address, count)

    def _read_discrete_inputs(self, address: int, count: int) -> Sequence[bool]:
        raise _no_address(address, count)

    def _read_registers(self, address: int, count: int) -> Sequence[int]:
        raise _no_address(address, count)

    def _write_coils(self, address: int, bits: Sequence[bool]) -> None:
        raise _no_address(address, len(bits))

    def _write_registers(self, address: int, words: Sequence[int]) -> None:
        raise _no_address(address, len(words))

    def _identification(self) -> dict[int, str]:
        return {}


def _no_address(address: int, count: int) -> BadRequestError:
    return BadRequestError(f"nothing at {address} (count {count})", ExceptionCode.ILLEGAL_DATA_ADDRESS)


def refuse_address(address: int) -> BadRequestError:
    """Return exception 2: there is nothing at this address."""
    return BadRequestError(f"nothing at {address}", ExceptionCode.ILLEGAL_DATA_ADDRESS)


def refuse_value(reason: str) -> BadRequestError:
    """Return exception 3: this value is not allowed."""
    return BadRequestError(reason, ExceptionCode.ILLEGAL_DATA_VALUE)


def refuse_function(reason: str) -> BadRequestError:
    """Return exception 1: this function is not served, or not now."""
    return BadRequestError(reason, ExceptionCode.ILLEGAL_FUNCTION)
