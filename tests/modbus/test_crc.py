from __future__ import annotations

from pymodbus.framer import FramerRTU

from gateway.modbus.adu import crc16


def test_the_check_value_of_the_catalogue_comes_out() -> None:
    assert crc16(b"123456789") == 0x4B37  # CRC-16/MODBUS


def test_no_bytes_leave_the_start_value() -> None:
    assert crc16(b"") == 0xFFFF


def test_the_low_byte_goes_first_on_the_wire() -> None:
    frame = bytes.fromhex("01 03 00 02 00 02 65 CB")  # ssw07 5.4.2

    assert crc16(frame[:-2]) == 0xCB65


def test_a_frame_with_its_own_crc_leaves_no_remainder() -> None:
    assert crc16(bytes.fromhex("14 0F 00 64 00 02 01 03 2E 6D")) == 0  # ssw07 5.4.5


def test_an_independent_library_agrees_on_every_message_of_two_bytes() -> None:
    # 65,536 messages reach every table entry in every position; the SSW-07's printed code gets four right.
    messages = (bytes((high, low)) for high in range(256) for low in range(256))

    wrong = [m for m in messages if crc16(m).to_bytes(2, "little") != FramerRTU.compute_CRC(m).to_bytes(2)]

    assert wrong == []
