"""The limits and the strictness of reads and writes; vectors and pymodbus judge their bytes."""

from __future__ import annotations

import random
from collections.abc import Callable
from typing import Any

import pytest

from gateway.errors import BadReplyError
from gateway.modbus.pdu import Request
from tests.modbus.samples import CLASSES, MOST, fc, random_request, reply_of

# How a request of `count` things from `address` on is built, and the most of them.
COUNTED: list[Any] = [
    *[(lambda address, count, f=f: fc(f, address, count), MOST[f]) for f in (1, 2, 3, 4)],
    (lambda address, count: fc(15, address, (True,) * count), 1968),
    (lambda address, count: fc(16, address, (7,) * count), 123),
]


@pytest.mark.parametrize(("build", "most"), COUNTED)
def test_a_run_has_as_many_places_as_the_specification_allows_and_ends_at_the_last_address(
    build: Callable[[int, int], Request], most: int
) -> None:
    request = build(0x10000 - most, most)

    assert max(len(request.encode()), request.reply_size() or 0) <= 253
    for count in (0, most + 1):
        with pytest.raises(ValueError, match=f"count {count} is not in"):
            build(0, count)
    for address, count in ((0x10000 - most + 1, most), (0x10000, 1), (-1, 1)):
        with pytest.raises(ValueError, match="addresses"):
            build(address, count)


@pytest.mark.parametrize(("function", "arguments"), [(5, (True,)), (6, (1,)), (22, (1, 1))])
def test_a_single_address_is_one_that_exists(function: int, arguments: tuple[Any, ...]) -> None:
    fc(function, 0xFFFF, *arguments)

    for address in (-1, 0x10000):
        with pytest.raises(ValueError, match="addresses"):
            fc(function, address, *arguments)


@pytest.mark.parametrize("word", [-1, 0x10000])
def test_a_number_that_fits_no_register_is_refused(word: int) -> None:
    for arguments in (
        (6, 0, word),
        (16, 0, (1, word)),
        (22, 0, word, 0),
        (22, 0, 0, word),
    ):
        with pytest.raises(ValueError, match="fit a register"):
            fc(*arguments)
    with pytest.raises(ValueError, match="fit a register"):
        reply_of(fc(3, 0, 1), (word,))


def test_reads_and_writes_are_distinguished() -> None:
    rng = random.Random(1)

    assert [number for number in CLASSES if random_request(rng, number).is_write] == [5, 6, 15, 16, 22]


REFUSED = "refused"


@pytest.mark.parametrize(
    ("request_", "reply", "value"),
    [
        (fc(1, 0, 10), "01 02 01 02", (True, *(False,) * 8, True)),  # the first coil is the lowest bit
        (fc(1, 0, 2), "01 01 FE", (False, True)),  # bits that fill up the last byte are ignored
        (fc(4, 13, 1), "04 02 00 FF", (0x00FF,)),  # high byte first
        (fc(4, 0, 2), "04 02 00 01 00 02", REFUSED),  # the SST's manual describes it so, as if it were FC01
        (fc(16, 30, (1, 2, 3)), "10 00 1E 00 03", None),  # acknowledged by their own quantity
        (fc(16, 30, (1, 2, 3)), "10 00 1E 00 06", REFUSED),
    ],
)
def test_a_reply_says(request_: Any, reply: str, value: Any) -> None:
    if value == REFUSED:
        with pytest.raises(BadReplyError):
            request_.decode_reply(bytes.fromhex(reply))
    else:
        assert request_.decode_reply(bytes.fromhex(reply)) == value


@pytest.mark.parametrize(("size", "shown"), [(0, "nothing"), (32, "00( 00){31}"), (33, r"(00 ){32}\.\.")])
def test_a_refused_reply_is_shown_in_hex_and_cut_short(size: int, shown: str) -> None:
    with pytest.raises(BadReplyError, match=f"function 3: {shown}$"):
        fc(3, 0, 1).decode_reply(bytes(size))
