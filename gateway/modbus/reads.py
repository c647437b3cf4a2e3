"""The requests that only read: coils, discrete inputs, holding and input registers [APP 6.1-6.4].

Replies that consist of registers: byte count and words, high byte first [APP 4.2, 6.3, 6.4].
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from gateway.modbus.codes import Function
from gateway.modbus.pdu import (
    byte_count,
    check_run,
    check_words,
    mismatch,
    pack_bits,
    unpack_bits,
)


@dataclass(frozen=True, slots=True)
class _ReadRun:
    """The base of the four reads: a run of neighbours in one table."""

    address: int
    count: int

    function: ClassVar[Function]
    max_count: ClassVar[int]
    is_write: ClassVar[bool] = False

    def __post_init__(self) -> None:
        check_run(self.address, self.count, max_count=self.max_count)

    def encode(self) -> bytes:
        """Return the request PDU."""
        return struct.pack(">BHH", self.function, self.address, self.count)


class _ReadBits(_ReadRun):
    __slots__ = ()
    max_count: ClassVar[int] = 2000  # [APP 6.1, 6.2]

    def decode_reply(self, pdu: bytes) -> tuple[bool, ...]:
        """Return the bits of a reply that answers exactly this request."""
        size = byte_count(self.count)
        if pdu[:2] != bytes((self.function, size)) or len(pdu) != 2 + size:
            raise mismatch(self, pdu)
        return unpack_bits(pdu[2:], self.count)

    def encode_reply(self, bits: Sequence[bool]) -> bytes:
        """Return the reply PDU; ValueError unless it has as many bits as were asked for."""
        if len(bits) != self.count:
            raise ValueError(f"{len(bits)} bits for a request of {self.count}")
        return bytes((self.function, byte_count(self.count))) + pack_bits(bits)

    def reply_size(self) -> int:
        """Return the length of the normal reply PDU."""
        return 2 + byte_count(self.count)


class _ReadWords(_ReadRun):
    __slots__ = ()
    max_count: ClassVar[int] = 125  # [APP 6.3, 6.4]

    def decode_reply(self, pdu: bytes) -> tuple[int, ...]:
        """Return the words of a reply that answers exactly this request."""
        size = 2 * self.count
        if pdu[:2] != bytes((self.function, size)) or len(pdu) != 2 + size:
            raise mismatch(self, pdu)
        return struct.unpack_from(f">{self.count}H", pdu, 2)

    def encode_reply(self, words: Sequence[int]) -> bytes:
        """Return the reply PDU; ValueError unless it has as many words as were asked for."""
        if len(words) != self.count:
            raise ValueError(f"{len(words)} words for a request of {self.count}")
        check_words(words)
        return struct.pack(f">BB{self.count}H", self.function, 2 * self.count, *words)

    def reply_size(self) -> int:
        """Return the length of the normal reply PDU."""
        return 2 + 2 * self.count


@dataclass(frozen=True, slots=True)
class ReadCoils(_ReadBits):
    """Ask for a run of 1..2000 coils (function 0x01, [APP 6.1])."""

    function: ClassVar[Function] = Function.READ_COILS


@dataclass(frozen=True, slots=True)
class ReadDiscreteInputs(_ReadBits):
    """Ask for a run of 1..2000 discrete inputs (function 0x02, [APP 6.2])."""

    function: ClassVar[Function] = Function.READ_DISCRETE_INPUTS


@dataclass(frozen=True, slots=True)
class ReadHoldingRegisters(_ReadWords):
    """Ask for a run of 1..125 holding registers (function 0x03, [APP 6.3])."""

    function: ClassVar[Function] = Function.READ_HOLDING_REGISTERS


@dataclass(frozen=True, slots=True)
class ReadInputRegisters(_ReadWords):
    """Ask for a run of 1..125 input registers (function 0x04, [APP 6.4])."""

    function: ClassVar[Function] = Function.READ_INPUT_REGISTERS
