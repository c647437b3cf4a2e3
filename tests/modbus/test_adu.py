"""Frames: units, lengths, CRC, and the length of a frame from its first bytes."""

from __future__ import annotations

import pytest
from pymodbus.framer import FramerRTU

from gateway.errors import BadFrameError
from gateway.modbus import adu
from gateway.modbus.adu import crc16
from gateway.modbus.codes import exception_name


def test_an_independent_library_agrees_on_every_message_of_two_bytes() -> None:
    # 65,536 messages reach every table entry in every position; the SSW-07's printed code gets four right.
    messages = (bytes((high, low)) for high in range(256) for low in range(256))

    wrong = [m for m in messages if crc16(m).to_bytes(2, "little") != FramerRTU.compute_CRC(m).to_bytes(2)]

    assert wrong == []
    assert crc16(b"123456789") == 0x4B37  # the check value of CRC-16/MODBUS


def test_a_frame_is_encoded_for_every_unit_for_broadcast_and_for_up_to_256_bytes() -> None:
    for unit, size in ((0, 1), (1, 5), (247, 253)):
        frame = adu.encode(unit, bytes(size))
        assert (len(frame), adu.decode(frame)) == (size + 3, (unit, bytes(size)))


def test_no_frame_is_encoded_for_a_reserved_unit_or_an_impossible_length() -> None:
    for unit, size in ((-1, 5), (248, 5), (1, 0), (1, 254)):
        with pytest.raises(ValueError, match=r"1\.\.253" if unit == 1 else r"0\.\.247"):
            adu.encode(unit, bytes(size))


COUNTED = (1, 2, 3, 4)
LONGEST = ["01 2B 0E 01 81 00 00 01 00 FF", *(f"01 {function:02X} FB" for function in COUNTED)]


def test_no_frame_is_longer_than_256_bytes_whatever_it_announces() -> None:
    """The lengths of others: test_properties.py."""
    assert {adu.reply_adu_size(bytes.fromhex(head)) for head in LONGEST} == {256}


UNKNOWN = [0, 7, 8, 17, 24, 42, 44, 127, 0x80, 0x87, 0xFF]


@pytest.mark.parametrize(
    ("head", "why"),
    [
        *[(f"01 {each:02X}", "function") for each in UNKNOWN],
        *[(f"01 {function:02X} FC", "byte count 252") for function in COUNTED],
        ("00 06", "unit 0"),
        ("01 2B 0D", "MEI type 13"),
    ],
)
def test_what_begins_no_frame_is_refused(head: str, why: str) -> None:
    with pytest.raises(BadFrameError, match=why):
        adu.reply_adu_size(bytes.fromhex(head))


def test_an_exception_of_the_specification_has_its_name() -> None:
    assert [exception_name(code) for code in (2, 7)] == ["illegal data address", "exception 7"]
