"""The requests that change something in a unit [APP 6.5, 6.6, 6.11, 6.12, 6.16]."""

from __future__ import annotations

import struct
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

from gateway.modbus.codes import Function
from gateway.modbus.pdu import (
    byte_count,
    check_run,
    check_words,
    mismatch,
    pack_bits,
)

COIL_ON = 0xFF00  # [APP 6.5]
COIL_OFF = 0x0000


class _Acknowledged(ABC):
    """The base of all writes: the reply repeats the request, and says nothing else."""

    __slots__ = ()
    is_write: ClassVar[bool] = True
    function: ClassVar[Function]

    @abstractmethod
    def encode(self) -> bytes:
        """Return the request PDU."""

    def encode_reply(self) -> bytes:
        """Return the reply PDU: the request's echo, unless the function has another."""
        return self.encode()

    def decode_reply(self, pdu: bytes) -> None:
        """Accept only the acknowledgement of this request."""
        if pdu != self.encode_reply():
            raise mismatch(self, pdu)

    def reply_size(self) -> int:
        """Return the length of the normal reply PDU."""
        return len(self.encode_reply())


@dataclass(frozen=True, slots=True)
class WriteCoil(_Acknowledged):
    """Set or clear one coil (function 0x05, [APP 6.5])."""

    address: int
    is_on: bool

    function: ClassVar[Function] = Function.WRITE_COIL

    def __post_init__(self) -> None:
        check_run(self.address, 1, max_count=1)

    def encode(self) -> bytes:
        """Return the request PDU."""
        return struct.pack(">BHH", self.function, self.address, COIL_ON if self.is_on else COIL_OFF)


@dataclass(frozen=True, slots=True)
class WriteRegister(_Acknowledged):
    """Write one holding register (function 0x06, [APP 6.6])."""

    address: int
    word: int

    function: ClassVar[Function] = Function.WRITE_REGISTER

    def __post_init__(self) -> None:
        check_run(self.address, 1, max_count=1)
        check_words((self.word,))

    def encode(self) -> bytes:
        """Return the request PDU."""
        return struct.pack(">BHH", self.function, self.address, self.word)


@dataclass(frozen=True, slots=True)
class WriteCoils(_Acknowledged):
    """Write a run of 1..1968 coils (function 0x0F, [APP 6.11])."""

    address: int
    bits: tuple[bool, ...]

    function: ClassVar[Function] = Function.WRITE_COILS
    max_count: ClassVar[int] = 1968  # [APP 6.11]

    def __post_init__(self) -> None:
        check_run(self.address, len(self.bits), max_count=self.max_count)

    def encode(self) -> bytes:
        """Return the request PDU."""
        count = len(self.bits)
        head = struct.pack(">BHHB", self.function, self.address, count, byte_count(count))
        return head + pack_bits(self.bits)

    def encode_reply(self) -> bytes:
        """Return the reply PDU: address and quantity."""
        return struct.pack(">BHH", self.function, self.address, len(self.bits))


@dataclass(frozen=True, slots=True)
class WriteRegisters(_Acknowledged):
    """Write a run of 1..123 holding registers (function 0x10, [APP 6.12])."""

    address: int
    words: tuple[int, ...]

    function: ClassVar[Function] = Function.WRITE_REGISTERS
    max_count: ClassVar[int] = 123  # [APP 6.12]

    def __post_init__(self) -> None:
        check_run(self.address, len(self.words), max_count=self.max_count)
        check_words(self.words)

    def encode(self) -> bytes:
        """Return the request PDU."""
        count = len(self.words)
        return struct.pack(f">BHHB{count}H", self.function, self.address, count, 2 * count, *self.words)

    def encode_reply(self) -> bytes:
        """Return the reply PDU: address and quantity."""
        return struct.pack(">BHH", self.function, self.address, len(self.words))


@dataclass(frozen=True, slots=True)
class MaskWriteRegister(_Acknowledged):
    """Set a register to (old AND and_mask) OR (or_mask AND NOT and_mask) (function 0x16, [APP 6.16])."""

    address: int
    and_mask: int
    or_mask: int

    function: ClassVar[Function] = Function.MASK_WRITE_REGISTER

    def __post_init__(self) -> None:
        check_run(self.address, 1, max_count=1)
        check_words((self.and_mask, self.or_mask))

    def encode(self) -> bytes:
        """Return the request PDU."""
        return struct.pack(">BHHH", self.function, self.address, self.and_mask, self.or_mask)

    def apply(self, word: int) -> int:
        """Return what the register holds afterwards."""
        return (word & self.and_mask) | (self.or_mask & ~self.and_mask & 0xFFFF)
