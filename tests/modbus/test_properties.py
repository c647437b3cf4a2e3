"""What must hold for every request, every reply and every frame."""

from __future__ import annotations

import random
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.errors import BadFrameError, BadRequestError
from gateway.modbus import adu
from gateway.modbus.server import decode_request
from tests.modbus.request_size import request_adu_size
from tests.modbus.samples import random_reply, random_request

PROPERTY = settings(max_examples=100)
dice = st.integers(0, 2**32).map(random.Random)


def bears(error: type[Exception], call: Any, *arguments: Any) -> bool:
    """Whether a call fails with exactly this error; any other one is the test's failure."""
    try:
        call(*arguments)
    except error:
        return True
    return False


@PROPERTY
@given(dice)
def test_the_length_of_a_frame_is_given_right_by_every_beginning_that_gives_it(rng: random.Random) -> None:
    request = random_request(rng)
    reply = random_reply(rng, request)
    pdus = {adu.reply_adu_size: reply, request_adu_size: request.encode()}
    assert reply[0] != request.function or request.reply_size() in (None, len(reply))

    for size_of, pdu in pdus.items():
        frame = adu.encode(1, pdu)
        sizes = [size_of(frame[:length]) for length in range(len(frame) + 1)]

        known_from = sizes.index(len(frame))
        assert sizes[:known_from] == [None] * known_from
        assert sizes[known_from:] == [len(frame)] * (len(frame) + 1 - known_from)
        assert known_from <= len(frame) - 2  # the CRC is never needed


@PROPERTY
@given(st.one_of(st.binary(max_size=300), st.binary(max_size=8).map(lambda tail: b"\x2b\x0e" + tail)))
def test_any_bytes_are_a_frame_and_a_request_or_are_refused(received: bytes) -> None:
    bears(BadFrameError, adu.decode, received)
    for size_of in (adu.reply_adu_size, request_adu_size):
        if not bears(BadFrameError, size_of, received):
            assert size_of(received) in (None, *range(5, 257))
    if not bears(BadRequestError, decode_request, received) and received[0] != 15:
        assert decode_request(received).encode() == received  # FC15's last byte may be filled with anything
