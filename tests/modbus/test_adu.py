from __future__ import annotations

import pytest

from gateway.errors import BadFrameError
from gateway.modbus import adu
from gateway.modbus.codes import Function
from gateway.modbus.writes import WriteRegister
from tests.modbus.request_size import request_adu_size


def frame(head: str) -> bytes:
    """The frame of a unit and PDU in hex, with its CRC."""
    raw = bytes.fromhex(head)
    return adu.encode(raw[0], raw[1:])


@pytest.mark.parametrize("unit", [0, 1, 247])
def test_a_frame_is_encoded_for_every_unit_and_for_broadcast(unit: int) -> None:
    pdu = WriteRegister(1, 2).encode()

    assert adu.decode(adu.encode(unit, pdu)) == (unit, pdu)


@pytest.mark.parametrize("unit", [-1, 248, 255, 256])
def test_no_frame_is_encoded_for_a_reserved_unit(unit: int) -> None:
    with pytest.raises(ValueError, match=r"0\.\.247"):
        adu.encode(unit, b"\x03")


@pytest.mark.parametrize("size", [0, 254])
def test_no_frame_is_encoded_for_a_pdu_of_impossible_length(size: int) -> None:
    with pytest.raises(ValueError, match=r"1\.\.253"):
        adu.encode(1, bytes(size))


def test_the_longest_frame_has_256_bytes() -> None:
    longest = adu.encode(1, bytes(253))

    assert len(longest) == 256
    assert adu.decode(longest).pdu == bytes(253)


def test_a_frame_that_is_too_long_is_refused_even_with_its_crc() -> None:
    whole = frame("01 03 04 01 F4 01 90")
    padded = whole + bytes(257 - len(whole))

    with pytest.raises(BadFrameError, match="257 bytes"):
        adu.decode(padded)


@pytest.mark.parametrize("size", range(4))
def test_a_frame_that_is_too_short_is_refused(size: int) -> None:
    # FF FF is the right CRC of no bytes at all: the length alone refuses it.
    with pytest.raises(BadFrameError, match=f"{size} bytes"):
        adu.decode((b"\xff\xff" + bytes(1))[:size])


def test_a_crc_with_its_bytes_exchanged_is_refused() -> None:
    with pytest.raises(BadFrameError, match="CRC cb 65 instead of 65 cb"):
        adu.decode(bytes.fromhex("01 03 00 02 00 02 CB 65"))


@pytest.mark.parametrize("size", [0, 1])
def test_less_than_a_function_gives_no_length(size: int) -> None:
    head = b"\x01"[:size]

    assert adu.reply_adu_size(head) is None
    assert request_adu_size(head) is None


@pytest.mark.parametrize("function", Function)
def test_an_exception_reply_has_five_bytes(function: Function) -> None:
    assert adu.reply_adu_size(bytes((1, function | 0x80))) == 5


@pytest.mark.parametrize(
    ("head", "size"),
    [("01 05", 8), ("01 06", 8), ("01 0F", 8), ("01 10", 8), ("01 16", 10)],
)
def test_the_reply_of_a_write_has_a_fixed_length(head: str, size: int) -> None:
    assert adu.reply_adu_size(bytes.fromhex(head)) == size


@pytest.mark.parametrize("function", [1, 2, 3, 4, 23])
def test_the_reply_of_a_read_is_as_long_as_its_byte_count_says(function: int) -> None:
    assert adu.reply_adu_size(bytes((1, function))) is None
    assert adu.reply_adu_size(bytes((1, function, 4))) == 9
    assert adu.reply_adu_size(bytes((1, function, 251))) == 256


@pytest.mark.parametrize("function", [1, 2, 3, 4, 23])
def test_a_byte_count_that_no_frame_can_hold_is_refused(function: int) -> None:
    with pytest.raises(BadFrameError, match="byte count 252"):
        adu.reply_adu_size(bytes((1, function, 252)))


@pytest.mark.parametrize("function", [0, 7, 8, 17, 24, 42, 44, 127, 0x80, 0x87, 0xFF])
def test_a_function_that_no_one_asked_for_begins_no_reply_and_no_request(function: int) -> None:
    head = bytes((1, function))

    with pytest.raises(BadFrameError, match="function"):
        adu.reply_adu_size(head)
    with pytest.raises(BadFrameError, match="function"):
        request_adu_size(head)


def test_a_broadcast_has_no_reply() -> None:
    with pytest.raises(BadFrameError, match="unit 0"):
        adu.reply_adu_size(bytes.fromhex("00 06"))


def test_a_broadcast_is_a_request() -> None:
    assert request_adu_size(bytes.fromhex("00 06")) == 8


@pytest.mark.parametrize(
    ("head", "size"),
    [
        ("01 01", 8),
        ("01 02", 8),
        ("01 03", 8),
        ("01 04", 8),
        ("01 05", 8),
        ("01 06", 8),
        ("01 16", 10),
        ("01 2B", 7),
        ("01 0F 00 64 00 02", None),
        ("01 0F 00 64 00 02 01", 10),
        ("01 10 01 39 00 02", None),
        ("01 10 01 39 00 02 04", 13),
        ("01 17 00 00 00 01 00 00 00 02", None),
        ("01 17 00 00 00 01 00 00 00 02 04", 17),
    ],
)
def test_the_length_of_a_request_is_known_from_its_first_bytes(head: str, size: int | None) -> None:
    assert request_adu_size(bytes.fromhex(head)) == size


@pytest.mark.parametrize(
    "head", ["01 0F 00 00 07 B0 F8", "01 10 00 00 00 7C F8", "01 17 00 00 00 01 00 00 00 7A F4"]
)
def test_a_request_whose_byte_count_no_frame_can_hold_is_refused(head: str) -> None:
    with pytest.raises(BadFrameError, match="byte count"):
        request_adu_size(bytes.fromhex(head))


def test_the_length_of_an_identification_is_known_with_its_last_object_s_length() -> None:
    whole = frame("01 2B 0E 01 81 00 00 02 00 03 57 45 47 02 05 56 31 2E 31 31")

    sizes = [adu.reply_adu_size(whole[:length]) for length in range(len(whole) + 1)]

    assert sizes[:15] == [None] * 15
    assert sizes[15:] == [len(whole)] * (len(whole) - 14)


def test_an_identification_without_objects_ends_after_their_number() -> None:
    assert adu.reply_adu_size(bytes.fromhex("01 2B 0E 01 81 00 00 00")) == 10


def test_another_encapsulated_interface_is_refused() -> None:
    for size_of in (adu.reply_adu_size, request_adu_size):
        with pytest.raises(BadFrameError, match="MEI type 13"):
            size_of(bytes.fromhex("01 2B 0D"))


def test_an_object_longer_than_any_frame_makes_the_longest_frame() -> None:
    assert adu.reply_adu_size(bytes.fromhex("01 2B 0E 01 81 00 00 01 00 FF")) == 256


def test_an_identification_with_a_wrong_object_length_never_seems_complete_too_early() -> None:
    misprint = frame(  # ssw06-es 5.4.7: object 1 says 14h and has 0Ch
        "01 2B 0E 01 81 00 00 03 00 03 57 45 47 "
        "01 14 53 53 57 2D 30 36 20 38 35 2E 30 41 02 05 56 31 2E 31 31"
    )

    sizes = {adu.reply_adu_size(misprint[:length]) for length in range(len(misprint) + 1)}

    assert sizes == {None}
