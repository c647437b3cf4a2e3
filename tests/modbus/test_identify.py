from __future__ import annotations

import pytest

from gateway.errors import BadReplyError
from gateway.modbus.device_id import DeviceIdentification, ReadDeviceIdentification

BASIC = ReadDeviceIdentification()


def reply(tail: str) -> bytes:
    """The reply to a basic stream, from the conformity level on."""
    return bytes.fromhex("2B 0E 01 " + tail)


def test_a_request_is_four_bytes() -> None:
    assert ReadDeviceIdentification(read_code=4, object_id=2).encode() == bytes.fromhex("2B 0E 04 02")


def test_only_its_reply_contains_its_length() -> None:
    assert BASIC.reply_size() is None


def test_it_is_no_write() -> None:
    assert not BASIC.is_write


@pytest.mark.parametrize("read_code", [0, 5, -1])
def test_a_read_code_beyond_the_specification_is_refused(read_code: int) -> None:
    with pytest.raises(ValueError, match="read code"):
        ReadDeviceIdentification(read_code=read_code)


@pytest.mark.parametrize("object_id", [-1, 256])
def test_an_object_that_fits_no_byte_is_refused(object_id: int) -> None:
    with pytest.raises(ValueError, match="object"):
        ReadDeviceIdentification(object_id=object_id)


@pytest.mark.parametrize("conformity", ["00", "01", "51", "81", "FF"])
def test_the_conformity_level_does_not_matter(conformity: str) -> None:
    said = BASIC.decode_reply(reply(f"{conformity} 00 00 01 00 03 57 45 47"))

    assert said == DeviceIdentification(objects={0: "WEG"})


def test_more_follows_and_where_to_go_on_are_reported() -> None:
    said = BASIC.decode_reply(reply("81 FF 02 01 00 03 57 45 47"))

    assert (said.more_follows, said.next_object) == (True, 2)


def test_an_empty_object_is_an_empty_text() -> None:
    assert BASIC.decode_reply(reply("81 00 00 02 00 00 01 01 41")).objects == {0: "", 1: "A"}


def test_an_object_that_runs_past_the_end_keeps_its_printable_characters() -> None:
    said = BASIC.decode_reply(reply("81 00 00 01 01 14 53 53 57 2D 30 36"))

    assert said.objects == {1: "SSW-06"}


def test_the_next_object_begins_after_the_printable_characters() -> None:
    said = BASIC.decode_reply(reply("81 00 00 02 01 14 53 53 57 02 05 56 31 2E 31 31"))

    assert said.objects == {1: "SSW", 2: "V1.11"}


def test_objects_that_are_announced_but_missing_are_left_out() -> None:
    said = BASIC.decode_reply(reply("81 00 00 03 00 03 57 45 47 01"))

    assert said.objects == {0: "WEG"}


def test_space_and_tilde_are_the_outermost_printable_characters() -> None:
    said = BASIC.decode_reply(reply("81 00 00 02 01 14 20 7E 7F 01 41"))

    assert said.objects == {1: " ~", 0x7F: "A"}


def test_an_object_without_any_printable_character_is_empty() -> None:
    assert BASIC.decode_reply(reply("81 00 00 01 01 09")).objects == {1: ""}


@pytest.mark.parametrize(
    "pdu",
    [
        "",
        "2B",
        "2B 0E 01 81 00 00",  # no number of objects
        "2B 0D 01 81 00 00 00",  # another interface
        "2B 0E 02 81 00 00 00",  # another read code
        "2C 0E 01 81 00 00 00",  # another function
        "AB 01",  # an exception
        "2B 0E 01 81 00 00 01 00 03 57 45 47 00",  # bytes after the last object
        "2B 0E 01 81 00 00 01 01 09 00 00",  # what runs past the end is not even text
    ],
)
def test_what_is_no_identification_is_refused(pdu: str) -> None:
    with pytest.raises(BadReplyError):
        BASIC.decode_reply(bytes.fromhex(pdu))


def test_one_object_is_answered_with_that_object() -> None:
    request = ReadDeviceIdentification(read_code=4, object_id=1)

    said = request.decode_reply(bytes.fromhex("2B 0E 04 81 00 00 01 01 03 53 53 57"))

    assert said.objects == {1: "SSW"}


def test_one_object_is_not_answered_with_another() -> None:
    request = ReadDeviceIdentification(read_code=4, object_id=1)

    with pytest.raises(BadReplyError):
        request.decode_reply(bytes.fromhex("2B 0E 04 81 00 00 01 02 03 53 53 57"))


def test_a_reply_longer_than_a_pdu_is_not_encoded() -> None:
    fits = DeviceIdentification(objects={0: "x" * 244})
    too_long = DeviceIdentification(objects={0: "x" * 245})

    assert len(BASIC.encode_reply(fits)) == 253
    with pytest.raises(ValueError, match="254 bytes"):
        BASIC.encode_reply(too_long)


def test_the_simulated_unit_may_claim_any_conformity() -> None:
    pdu = BASIC.encode_reply(DeviceIdentification(objects={}), conformity=0x51)

    assert pdu == reply("51 00 00 00")


def test_a_wrong_length_that_happens_to_fit_the_reply_swallows_no_other_object() -> None:
    text = b"SSW-06 100.0A"  # 13 characters, and the manual's length of 14h (ssw06-es 5.4.7)
    tail = bytes((0, 3)) + b"WEG" + bytes((1, 0x14)) + text + bytes((2, 5)) + b"V1.60"

    said = BASIC.decode_reply(reply("81 00 00 03") + tail)

    assert said.objects == {0: "WEG", 1: "SSW-06 100.0A", 2: "V1.60"}
