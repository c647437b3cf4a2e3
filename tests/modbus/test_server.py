from __future__ import annotations

import pytest

from gateway.errors import BadRequestError
from gateway.modbus.codes import ExceptionCode
from gateway.modbus.server import decode_request
from gateway.modbus.writes import WriteCoils


@pytest.mark.parametrize(
    "pdu",
    [
        "",
        "00",
        "07",  # read exception status: serial lines may have it, these starters have not
        "83 02",
        "2B 0D 01 00",  # CANopen over Modbus
        "2B",
    ],
)
def test_a_function_that_no_starter_has_is_answered_with_exception_1(pdu: str) -> None:
    with pytest.raises(BadRequestError) as error:
        decode_request(bytes.fromhex(pdu))

    assert error.value.exception_code == ExceptionCode.ILLEGAL_FUNCTION


@pytest.mark.parametrize(
    "pdu",
    [
        "01 00 00 00 00",  # none
        "01 00 00 07 D1",  # 2001 coils
        "02 00 00 07 D1",
        "03 00 00 00 00",
        "03 00 00 00 7E",  # 126 registers
        "03 FF FF 00 7E",  # quantity is judged before address
        "04 00 00 00 7E",
        "0F 00 00 00 00 00",
        "10 00 00 00 00 00",
        "10 00 00 00 7C F8" + "00" * 248,  # 124 registers
        "17 00 00 00 7E 00 00 00 01 02 00 00",
        "17 00 00 00 01 00 00 00 7A F4" + "00" * 244,  # 122 registers
    ],
)
def test_an_impossible_quantity_is_answered_with_exception_3(pdu: str) -> None:
    with pytest.raises(BadRequestError) as error:
        decode_request(bytes.fromhex(pdu))

    assert error.value.exception_code == ExceptionCode.ILLEGAL_DATA_VALUE


@pytest.mark.parametrize(
    "pdu",
    [
        "03 00 00 00",
        "03 00 00 00 01 00",
        "05 00 00 FF",
        "06 00 00 00 01 00",
        "16 00 00 00 01 00",
        "0F 00 00 00 01",
        "0F 00 00 00 01 01",
        "10 00 00 00 01",
        "10 00 00 00 01 02 00",
        "17 00 00 00 01 00 00 00 01",
        "17 00 00 00 01 00 00 00 01 02 00 00 00",
        "2B 0E 01",
    ],
)
def test_a_wrong_length_is_answered_with_exception_3(pdu: str) -> None:
    with pytest.raises(BadRequestError) as error:
        decode_request(bytes.fromhex(pdu))

    assert error.value.exception_code == ExceptionCode.ILLEGAL_DATA_VALUE


@pytest.mark.parametrize(
    "pdu",
    [
        "0F 00 00 00 09 01 00",
        "10 00 00 00 01 01 00",
        "10 00 00 00 02 02 00 00",
        "17 00 00 00 01 00 00 00 01 01 00",
    ],
)
def test_a_byte_count_that_does_not_fit_the_quantity_is_answered_with_exception_3(pdu: str) -> None:
    with pytest.raises(BadRequestError) as error:
        decode_request(bytes.fromhex(pdu))

    assert error.value.exception_code == ExceptionCode.ILLEGAL_DATA_VALUE


@pytest.mark.parametrize("value", ["00 01", "01 00", "FF FF", "FF 01"])
def test_a_coil_is_written_with_ff00_or_0000_only(value: str) -> None:
    with pytest.raises(BadRequestError) as error:
        decode_request(bytes.fromhex("05 00 64 " + value))

    assert error.value.exception_code == ExceptionCode.ILLEGAL_DATA_VALUE


@pytest.mark.parametrize("read_code", ["00", "05", "FF"])
def test_an_unknown_read_code_is_answered_with_exception_3(read_code: str) -> None:
    with pytest.raises(BadRequestError) as error:
        decode_request(bytes.fromhex(f"2B 0E {read_code} 00"))

    assert error.value.exception_code == ExceptionCode.ILLEGAL_DATA_VALUE


@pytest.mark.parametrize(
    "pdu",
    [
        "01 FF FF 00 02",
        "03 FF FF 00 02",
        "0F FF FF 00 02 01 03",
        "10 FF FF 00 02 04 00 00 00 00",
        "17 FF FF 00 02 00 00 00 01 02 00 00",
        "17 00 00 00 02 FF FF 00 02 04 00 00 00 00",
    ],
)
def test_a_run_beyond_the_last_address_is_answered_with_exception_2(pdu: str) -> None:
    with pytest.raises(BadRequestError) as error:
        decode_request(bytes.fromhex(pdu))

    assert error.value.exception_code == ExceptionCode.ILLEGAL_DATA_ADDRESS


def test_bits_that_fill_up_the_last_byte_are_ignored() -> None:
    assert decode_request(bytes.fromhex("0F 00 64 00 02 01 FF")) == WriteCoils(100, (True, True))
