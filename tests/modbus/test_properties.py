"""What must hold for every request, every reply and every frame."""

from __future__ import annotations

from typing import Any

from hypothesis import example, given
from hypothesis import strategies as st

from gateway.errors import BadFrameError, BadReplyError, BadRequestError
from gateway.modbus import adu
from gateway.modbus.device_id import DeviceIdentification, ReadDeviceIdentification
from gateway.modbus.pdu import exception_code
from gateway.modbus.server import KnownRequest, decode_request
from gateway.modbus.writes import WriteCoils
from tests.modbus.request_size import request_adu_size
from tests.modbus.strategies import PROPERTY, exchanges, reply_pdus, requests, units


def bears(error: type[Exception], call: Any, *arguments: Any) -> bool:
    """Whether a call fails with exactly this error; any other one is the test's failure."""
    try:
        call(*arguments)
    except error:
        return True
    return False


@PROPERTY
@given(requests())
def test_decoding_a_request_inverts_encoding_it(request: KnownRequest) -> None:
    pdu = request.encode()

    assert decode_request(pdu) == request
    assert len(pdu) <= 253


@PROPERTY
@given(exchanges())
def test_decoding_a_reply_inverts_encoding_it(exchange: tuple[KnownRequest, Any, bytes]) -> None:
    request, value, pdu = exchange

    assert request.decode_reply(pdu) == value
    assert exception_code(request, pdu) is None
    assert request.reply_size() in (None, len(pdu))


@PROPERTY
@given(units, reply_pdus())
def test_decoding_a_frame_inverts_encoding_it(unit: int, pdu: bytes) -> None:
    assert adu.decode(adu.encode(unit, pdu)) == (unit, pdu)


@PROPERTY
@given(units, reply_pdus(), st.data())
def test_a_frame_with_any_single_byte_changed_is_refused(unit: int, pdu: bytes, data: st.DataObject) -> None:
    frame = bytearray(adu.encode(unit, pdu))
    at = data.draw(st.integers(0, len(frame) - 1))
    change = data.draw(st.integers(1, 255))

    frame[at] ^= change

    assert bears(BadFrameError, adu.decode, bytes(frame))


def test_every_change_of_one_byte_of_one_frame_is_refused() -> None:
    frame = bytes.fromhex("01 03 04 01 F4 01 90 BB C1")  # ssw07 5.4.2
    changed = [
        frame[:at] + bytes((byte,)) + frame[at + 1 :]
        for at in range(len(frame))
        for byte in range(256)
        if byte != frame[at]
    ]

    accepted = [other for other in changed if not bears(BadFrameError, adu.decode, other)]

    assert len(changed) == 9 * 255
    assert accepted == []


@PROPERTY
@given(units, reply_pdus())
def test_the_length_of_a_reply_is_given_right_by_every_beginning_that_gives_it(unit: int, pdu: bytes) -> None:
    frame = adu.encode(unit, pdu)

    sizes = [adu.reply_adu_size(frame[:length]) for length in range(len(frame) + 1)]

    known_from = sizes.index(len(frame))
    assert sizes[:known_from] == [None] * known_from
    assert sizes[known_from:] == [len(frame)] * (len(frame) + 1 - known_from)
    assert known_from <= len(frame) - 2  # the CRC is never needed


@PROPERTY
@given(units, requests())
def test_the_length_of_a_request_is_given_right_by_every_beginning_that_gives_it(
    unit: int, request: KnownRequest
) -> None:
    frame = adu.encode(unit, request.encode())

    sizes = [request_adu_size(frame[:length]) for length in range(len(frame) + 1)]

    known_from = sizes.index(len(frame))
    assert sizes[:known_from] == [None] * known_from
    assert sizes[known_from:] == [len(frame)] * (len(frame) + 1 - known_from)
    assert known_from <= len(frame) - 2


@PROPERTY
@given(
    st.lists(st.tuples(st.integers(0, 255), st.binary(max_size=20), st.integers(0, 255)), max_size=4),
    st.integers(0, 5),
)
@example([(1, b"SSW-06 85.0A\x02\x05V1.11", 20)], 2)
def test_an_identification_is_never_thought_complete_before_its_end(
    objects: list[tuple[int, bytes, int]], number: int
) -> None:
    request = ReadDeviceIdentification()
    body = b"".join(bytes((key, size)) + text for key, text, size in objects)
    pdu = bytes.fromhex("2B 0E 01 81 00 00") + bytes((number,)) + body
    frame = adu.encode(1, pdu)

    sizes = [adu.reply_adu_size(frame[:length]) for length in range(len(frame) + 1)]

    if not bears(BadReplyError, request.decode_reply, pdu):
        assert all(size is None or size >= len(frame) for size in sizes)


@PROPERTY
@given(st.binary(max_size=300))
def test_any_bytes_are_a_frame_or_are_refused(received: bytes) -> None:
    bears(BadFrameError, adu.decode, received)
    for size_of in (adu.reply_adu_size, request_adu_size):
        if not bears(BadFrameError, size_of, received):
            assert size_of(received) in (None, *range(5, 257))


@PROPERTY
@given(exchanges(), st.data())
def test_a_damaged_reply_is_read_or_refused_but_never_breaks_anything(
    exchange: tuple[KnownRequest, Any, bytes], data: st.DataObject
) -> None:
    request, _, pdu = exchange
    cut = data.draw(st.integers(0, len(pdu)))
    tail = data.draw(st.binary(max_size=6))

    damaged = pdu[:cut] + tail

    if not bears(BadReplyError, request.decode_reply, damaged):
        assert damaged[0] == request.function
        assert request.reply_size() in (None, len(damaged))


@PROPERTY
@given(st.one_of(st.binary(max_size=260), st.binary(max_size=8).map(lambda tail: b"\x2b\x0e" + tail)))
def test_any_bytes_are_a_request_or_are_refused(pdu: bytes) -> None:
    if not bears(BadRequestError, decode_request, pdu):
        request = decode_request(pdu)
        if not isinstance(request, WriteCoils):  # whose last byte may be filled up with anything
            assert request.encode() == pdu


@PROPERTY
@given(st.integers(1, 3), st.dictionaries(st.integers(0, 255), st.text(max_size=3).filter(str.isascii)))
def test_an_identification_survives_the_way_to_the_simulator_and_back(
    read_code: int, objects: dict[int, str]
) -> None:
    request = ReadDeviceIdentification(read_code=read_code)
    identification = DeviceIdentification(objects=dict(list(objects.items())[:40]))

    assert request.decode_reply(request.encode_reply(identification)) == identification
