"""RTU frames: unit, PDU and CRC, and the length of a frame, from its first bytes [SERIAL 2.5.1]."""

from __future__ import annotations

from typing import NamedTuple

from gateway.errors import BadFrameError
from gateway.modbus.codes import EXCEPTION_BIT, MEI_DEVICE_IDENTIFICATION, Function
from gateway.modbus.pdu import MAX_PDU_SIZE

BROADCAST = 0  # every unit acts, none answers [SERIAL 2.1]
MAX_UNIT = 247  # [SERIAL 2.2]
MIN_ADU_SIZE = 4  # unit, function, CRC
MAX_ADU_SIZE = 256  # [SERIAL 2.5.1]

_CRC_SIZE = 2
_EXCEPTION_SIZE = 5

_COUNTED_REPLIES = frozenset(  # unit, function, byte count, that many bytes, CRC
    {
        Function.READ_COILS,
        Function.READ_DISCRETE_INPUTS,
        Function.READ_HOLDING_REGISTERS,
        Function.READ_INPUT_REGISTERS,
    }
)
FIXED_REPLIES = {  # the size of a frame that acknowledges a write
    Function.WRITE_COIL: 8,
    Function.WRITE_REGISTER: 8,
    Function.WRITE_COILS: 8,
    Function.WRITE_REGISTERS: 8,
    Function.MASK_WRITE_REGISTER: 10,
}
_KNOWN = frozenset(int(function) for function in Function)
_NUMBER_OF_OBJECTS_AT = 7  # in the reply 43/14 [APP 6.21]
_POLYNOMIAL = 0xA001  # x^16 + x^15 + x^2 + 1, bits reversed [SERIAL 6.2.2]
_START = 0xFFFF


class Adu(NamedTuple):
    """A frame whose CRC was right."""

    unit: int
    pdu: bytes


def encode(unit: int, pdu: bytes) -> bytes:
    """Return the frame of a PDU to or from a unit (0 is broadcast); ValueError for what no frame can hold."""
    if not BROADCAST <= unit <= MAX_UNIT:
        raise ValueError(f"unit {unit} is not in 0..{MAX_UNIT}")
    if not 1 <= len(pdu) <= MAX_PDU_SIZE:
        raise ValueError(f"a PDU of {len(pdu)} bytes is not in 1..{MAX_PDU_SIZE}")
    frame = bytes((unit,)) + pdu
    return frame + crc16(frame).to_bytes(_CRC_SIZE, "little")


def decode(adu: bytes) -> Adu:
    """Return unit and PDU of one whole frame; BadFrameError for a wrong length or CRC."""
    if not MIN_ADU_SIZE <= len(adu) <= MAX_ADU_SIZE:
        raise BadFrameError(f"{len(adu)} bytes, a frame has {MIN_ADU_SIZE}..{MAX_ADU_SIZE}")
    expected = crc16(adu[:-_CRC_SIZE]).to_bytes(_CRC_SIZE, "little")
    if adu[-_CRC_SIZE:] != expected:
        raise BadFrameError(f"CRC {adu[-_CRC_SIZE:].hex(' ')} instead of {expected.hex(' ')}")
    return Adu(unit=adu[0], pdu=adu[1:-_CRC_SIZE])


def reply_adu_size(head: bytes) -> int | None:
    """Return how long the reply that begins with `head` is in all; None when that is not known yet.

    Never says less than the true length; it says more (at most 256), or None permanently, only for an
    identification whose object lengths are wrong: silence ends such a frame. BadFrameError for what no
    reply can begin with.
    """
    if len(head) < 2:
        return None
    if head[0] == BROADCAST:
        raise BadFrameError("a reply from unit 0")
    function = head[1]
    if function & EXCEPTION_BIT:
        _require_known(function & ~EXCEPTION_BIT)
        return _EXCEPTION_SIZE
    if function in FIXED_REPLIES:
        return FIXED_REPLIES[Function(function)]
    if function in _COUNTED_REPLIES:
        return _counted_size(head, 2)
    _require_known(function)
    return _identification_size(head)


def _require_known(function: int) -> None:
    if function not in _KNOWN:
        raise BadFrameError(f"function {function}")


def _counted_size(head: bytes, count_at: int) -> int | None:
    """Return the length of a frame whose byte count stands at `count_at`, right before the bytes."""
    if len(head) <= count_at:
        return None
    size = count_at + 1 + head[count_at] + _CRC_SIZE
    if size > MAX_ADU_SIZE:
        raise BadFrameError(f"byte count {head[count_at]} makes {size} bytes, a frame has {MAX_ADU_SIZE}")
    return size


def _identification_size(head: bytes) -> int | None:
    """Return the length of a reply 43/14 by walking its objects [APP 6.21]."""
    if len(head) > 2 and head[2] != MEI_DEVICE_IDENTIFICATION:
        raise BadFrameError(f"MEI type {head[2]}")
    if len(head) <= _NUMBER_OF_OBJECTS_AT:
        return None
    at = _NUMBER_OF_OBJECTS_AT + 1
    for _ in range(head[_NUMBER_OF_OBJECTS_AT]):
        if len(head) < at + 2:
            return None
        at += 2 + head[at + 1]
    return min(at + _CRC_SIZE, MAX_ADU_SIZE)


def crc16(data: bytes) -> int:
    """Return the CRC-16 of `data`; it goes on the wire low byte first."""
    crc = _START
    for byte in data:
        crc = (crc >> 8) ^ _TABLE[(crc ^ byte) & 0xFF]
    return crc


def _remainder(byte: int) -> int:
    for _ in range(8):
        byte = (byte >> 1) ^ (_POLYNOMIAL if byte & 1 else 0)
    return byte


# Computed, not copied: the tables printed in the SSW-07 manual have lost rows (ssw07-ssw08 appendix A).
_TABLE = tuple(_remainder(byte) for byte in range(256))
