"""The limits and the strictness of reads and writes; vectors and pymodbus judge their bytes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from gateway.errors import BadReplyError
from gateway.modbus.pdu import Request, encode_exception, exception_code
from gateway.modbus.reads import ReadCoils, ReadDiscreteInputs, ReadHoldingRegisters, ReadInputRegisters
from gateway.modbus.writes import (
    MaskWriteRegister,
    ReadWriteRegisters,
    WriteCoil,
    WriteCoils,
    WriteRegister,
    WriteRegisters,
)

# How to build a request of `count` things from `address` on, and the most of them [APP 6].
COUNTED: list[Any] = [
    pytest.param(ReadCoils, 2000, id="FC01"),
    pytest.param(ReadDiscreteInputs, 2000, id="FC02"),
    pytest.param(ReadHoldingRegisters, 125, id="FC03"),
    pytest.param(ReadInputRegisters, 125, id="FC04"),
    pytest.param(lambda address, count: WriteCoils(address, (True,) * count), 1968, id="FC15"),
    pytest.param(lambda address, count: WriteRegisters(address, (7,) * count), 123, id="FC16"),
    pytest.param(lambda address, count: ReadWriteRegisters(address, count, 0, (7,)), 125, id="FC23-read"),
    pytest.param(
        lambda address, count: ReadWriteRegisters(0, 1, address, (7,) * count), 121, id="FC23-write"
    ),
]
Build = Callable[[int, int], Request]

SINGLE: list[Any] = [
    pytest.param(lambda address: WriteCoil(address, True), id="FC05"),
    pytest.param(lambda address: WriteRegister(address, 1), id="FC06"),
    pytest.param(lambda address: MaskWriteRegister(address, 1, 1), id="FC22"),
]

REQUESTS: list[Any] = [
    ReadCoils(0, 9),
    ReadDiscreteInputs(0, 8),
    ReadHoldingRegisters(0, 3),
    ReadInputRegisters(0, 3),
    WriteCoil(1, True),
    WriteRegister(1, 2),
    WriteCoils(1, (True, False)),
    WriteRegisters(1, (2, 3)),
    MaskWriteRegister(1, 2, 3),
    ReadWriteRegisters(1, 2, 3, (4,)),
]
every_request = pytest.mark.parametrize("request_", REQUESTS, ids=lambda request: type(request).__name__)


def normal_reply(request: Any) -> bytes:
    match request:
        case ReadCoils() | ReadDiscreteInputs():
            return request.encode_reply((True,) * request.count)
        case ReadHoldingRegisters() | ReadInputRegisters():
            return request.encode_reply((7,) * request.count)
        case ReadWriteRegisters():
            return request.encode_reply((7,) * request.read_count)
        case _:
            pdu: bytes = request.encode_reply()
            return pdu


@pytest.mark.parametrize(("build", "most"), COUNTED)
def test_as_many_are_asked_for_as_the_specification_allows(build: Build, most: int) -> None:
    request = build(0, most)

    assert len(request.encode()) <= 253
    assert (request.reply_size() or 0) <= 253


@pytest.mark.parametrize(("build", "most"), COUNTED)
def test_none_or_too_many_are_refused(build: Build, most: int) -> None:
    for count in (0, most + 1):
        with pytest.raises(ValueError, match=f"count {count} is not in"):
            build(0, count)


@pytest.mark.parametrize(("build", "most"), COUNTED)
def test_a_run_ends_at_the_last_address_at_the_latest(build: Build, most: int) -> None:
    build(0x10000 - most, most)

    for address, count in ((0x10000 - most + 1, most), (0x10000, 1), (-1, 1)):
        with pytest.raises(ValueError, match="addresses"):
            build(address, count)


@pytest.mark.parametrize("build", SINGLE)
def test_a_single_address_is_one_that_exists(build: Callable[[int], Request]) -> None:
    build(0xFFFF)

    for address in (-1, 0x10000):
        with pytest.raises(ValueError, match="addresses"):
            build(address)


@pytest.mark.parametrize("word", [-1, 0x10000])
def test_a_number_that_fits_no_register_is_refused(word: int) -> None:
    for build in (
        lambda: WriteRegister(0, word),
        lambda: WriteRegisters(0, (1, word)),
        lambda: MaskWriteRegister(0, word, 0),
        lambda: MaskWriteRegister(0, 0, word),
        lambda: ReadWriteRegisters(0, 1, 0, (word,)),
        lambda: ReadHoldingRegisters(0, 1).encode_reply((word,)),
    ):
        with pytest.raises(ValueError, match="fit a register"):
            build()


def test_reads_and_writes_are_distinguished() -> None:
    reads = {type(request).__name__ for request in REQUESTS if not request.is_write}

    assert reads == {"ReadCoils", "ReadDiscreteInputs", "ReadHoldingRegisters", "ReadInputRegisters"}


@every_request
def test_a_request_is_a_value(request_: Any) -> None:
    fields = (getattr(request_, name) for name in request_.__match_args__)

    assert {request_} == {type(request_)(*fields)}


@every_request
def test_the_reply_has_the_length_that_was_foretold(request_: Any) -> None:
    assert request_.reply_size() == len(normal_reply(request_))


@every_request
def test_a_reply_of_another_length_is_refused(request_: Any) -> None:
    reply = normal_reply(request_)

    for wrong in (b"", reply[:1], reply[:-1], reply + b"\x00"):
        with pytest.raises(BadReplyError):
            request_.decode_reply(wrong)


@every_request
def test_a_reply_of_another_function_is_refused(request_: Any) -> None:
    reply = normal_reply(request_)

    with pytest.raises(BadReplyError):
        request_.decode_reply(bytes((reply[0] ^ 1,)) + reply[1:])


@every_request
def test_an_exception_is_no_normal_reply(request_: Any) -> None:
    pdu = encode_exception(request_.function, 2)

    assert exception_code(request_, pdu) == 2
    with pytest.raises(BadReplyError):
        request_.decode_reply(pdu)


@every_request
def test_only_its_own_exception_counts(request_: Any) -> None:
    function = request_.function

    for pdu in (b"", bytes((function | 0x80,)), bytes((function | 0x80, 2, 0)), bytes((function ^ 0x81, 2))):
        assert exception_code(request_, pdu) is None
    assert exception_code(request_, normal_reply(request_)) is None


@pytest.mark.parametrize("code", [4, 6])
def test_the_exceptions_of_the_sst_are_decoded(code: int) -> None:
    assert exception_code(ReadInputRegisters(0, 43), bytes((0x84, code))) == code


@pytest.mark.parametrize(
    "request_",
    [request for request in REQUESTS if request.is_write and not isinstance(request, ReadWriteRegisters)],
    ids=lambda request: type(request).__name__,
)
def test_an_acknowledgement_with_any_other_byte_is_refused(request_: Any) -> None:
    reply = normal_reply(request_)

    for at in range(len(reply)):
        with pytest.raises(BadReplyError):
            request_.decode_reply(reply[:at] + bytes((reply[at] ^ 0x01,)) + reply[at + 1 :])


def test_the_first_coil_is_the_lowest_bit() -> None:
    request = ReadCoils(0, 10)

    bits = request.decode_reply(bytes.fromhex("01 02 01 02"))

    assert bits == (True, *(False,) * 8, True)


def test_bits_that_fill_up_the_last_byte_are_ignored() -> None:
    assert ReadCoils(0, 2).decode_reply(bytes.fromhex("01 01 FE")) == (False, True)


def test_registers_come_high_byte_first() -> None:
    assert ReadInputRegisters(13, 1).decode_reply(bytes.fromhex("04 02 00 FF")) == (0x00FF,)


def test_a_reply_that_counts_registers_instead_of_bytes_is_refused() -> None:
    # The SST's description of FC04 is copied from FC01; only twice the quantity is taken (sst-intecma, FC04).
    with pytest.raises(BadReplyError):
        ReadInputRegisters(0, 2).decode_reply(bytes.fromhex("04 02 00 01 00 02"))


def test_written_registers_are_acknowledged_by_their_own_quantity_alone() -> None:
    request = WriteRegisters(30, (1, 2, 3))

    request.decode_reply(bytes.fromhex("10 00 1E 00 03"))

    for wrong in ("10 00 1E 00 06", "10 00 1E 00 02", "10 00 1F 00 03", "10 00 1E 00 0C"):
        with pytest.raises(BadReplyError):
            request.decode_reply(bytes.fromhex(wrong))


def test_a_mask_sets_clears_and_keeps_bits() -> None:
    assert MaskWriteRegister(4, 0x00F2, 0x0025).apply(0x0012) == 0x0017  # the example of [APP 6.16]
    assert MaskWriteRegister(4, 0xFFFF, 0xFFFF).apply(0x1234) == 0x1234
    assert MaskWriteRegister(4, 0x0000, 0xABCD).apply(0x1234) == 0xABCD


@pytest.mark.parametrize("count", [1, 3])
def test_a_simulated_unit_answers_exactly_as_many_as_were_asked_for(count: int) -> None:
    with pytest.raises(ValueError, match=f"{count} bits for a request of 2"):
        ReadCoils(0, 2).encode_reply((True,) * count)
    with pytest.raises(ValueError, match=f"{count} words for a request of 2"):
        ReadInputRegisters(0, 2).encode_reply((1,) * count)
    with pytest.raises(ValueError, match=f"{count} words for a request of 2"):
        ReadWriteRegisters(0, 2, 0, (1,)).encode_reply((1,) * count)


def test_a_refused_reply_is_shown_in_hex_and_cut_short() -> None:
    with pytest.raises(BadReplyError, match=r"function 3: 04 02 00 01$"):
        ReadHoldingRegisters(0, 1).decode_reply(bytes.fromhex("04 02 00 01"))
    with pytest.raises(BadReplyError, match=r"function 3: nothing$"):
        ReadHoldingRegisters(0, 1).decode_reply(b"")
    with pytest.raises(BadReplyError, match=r"function 3: 00( 00){31}$"):
        ReadHoldingRegisters(0, 1).decode_reply(bytes(32))
    with pytest.raises(BadReplyError, match=r"function 3: (00 ){32}\.\.$"):
        ReadHoldingRegisters(0, 1).decode_reply(bytes(33))
