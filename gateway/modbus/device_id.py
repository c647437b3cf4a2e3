"""The identity of a unit: Read Device Identification (function 0x2B, MEI type 0x0E, [APP 6.21])."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from gateway.modbus.codes import MEI_DEVICE_IDENTIFICATION, Function
from gateway.modbus.pdu import MAX_PDU_SIZE, mismatch

STREAM_CODES = (1, 2, 3)  # basic, regular, extended: all objects from one on [APP 6.21]
ONE_OBJECT_CODE = 4

CONFORMITY = 0x81  # basic identification, stream and one object (as in ssw06-es 5.4.7)

_HEAD_SIZE = 7  # function, MEI type, read code, conformity, more follows, next object, number of objects
_PRINTABLE = range(0x20, 0x7F)  # ASCII


@dataclass(frozen=True, slots=True)
class DeviceIdentification:
    """The objects of one reply: 0 maker, 1 product code, 2 revision, and what the maker adds."""

    objects: dict[int, str]


@dataclass(frozen=True, slots=True)
class ReadDeviceIdentification:
    """Ask for a stream of identification objects from `object_id` on, or for one (read code 4)."""

    read_code: int = 1
    object_id: int = 0

    function: ClassVar[Function] = Function.ENCAPSULATED
    is_write: ClassVar[bool] = False

    def encode(self) -> bytes:
        """Return the request PDU."""
        return bytes((*self._head(), self.object_id))

    def decode_reply(self, pdu: bytes) -> DeviceIdentification:
        """Return the objects of a reply to this read code; objects that its frame lacks are left out.

        The conformity level is not checked: the SSW-07's own example has none that exists (ssw07 5.4.7).
        """
        if pdu[:3] != self._head() or len(pdu) < _HEAD_SIZE:
            raise mismatch(self, pdu)
        objects, end = _walk(pdu, number=pdu[_HEAD_SIZE - 1])
        if end != len(pdu):
            raise mismatch(self, pdu)
        return DeviceIdentification(objects)

    def encode_reply(self, identification: DeviceIdentification, *, conformity: int = CONFORMITY) -> bytes:
        """Return the reply PDU; ValueError when it is longer than a PDU may be."""
        objects = identification.objects
        head = (*self._head(), conformity, 0, 0, len(objects))  # nothing more follows
        texts = {key: text.encode("latin-1") for key, text in objects.items()}
        pdu = bytes(head) + b"".join(bytes((key, len(text))) + text for key, text in texts.items())
        if len(pdu) > MAX_PDU_SIZE:
            raise ValueError(f"{len(pdu)} bytes of identification, a PDU holds {MAX_PDU_SIZE}")
        return pdu

    def reply_size(self) -> int | None:
        """Return None: only the reply contains its length."""
        return None

    def _head(self) -> bytes:
        return bytes((self.function, MEI_DEVICE_IDENTIFICATION, self.read_code))


def _walk(pdu: bytes, number: int) -> tuple[dict[int, str], int]:
    """Return the objects and where they end.

    The lengths are believed where they divide the reply into as many objects as it announces. Otherwise
    (ssw06-es 5.4.7 prints 20 for a text of 12) an object ends with its printable characters.
    """
    objects, end = _cut(pdu, number, by_length=True)
    is_right = len(objects) == number and end == len(pdu)
    return (objects, end) if is_right else _cut(pdu, number, by_length=False)


def _cut(pdu: bytes, number: int, *, by_length: bool) -> tuple[dict[int, str], int]:
    objects: dict[int, str] = {}
    at = _HEAD_SIZE
    for _ in range(number):
        if at + 2 > len(pdu):
            return objects, len(pdu)
        object_id, size = pdu[at : at + 2]
        at += 2
        if not by_length:
            size = min(size, _printable_size(pdu, at))
        objects[object_id] = pdu[at : at + size].decode("latin-1")
        at += size
    return objects, at


def _printable_size(pdu: bytes, start: int) -> int:
    end = start
    while end < len(pdu) and pdu[end] in _PRINTABLE:
        end += 1
    return end - start
