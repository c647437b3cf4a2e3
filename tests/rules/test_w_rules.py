"""What all WEG starters share (W-xx), judged by bytes against the simulated ones."""

from __future__ import annotations

import pytest

from gateway.errors import BadFrameError
from gateway.families.profile.decode import decode_row
from gateway.families.profile.load import load_profile
from gateway.families.profile.parameters import to_words
from gateway.families.profile.rows import Table
from gateway.families.profile.schema import Variant
from gateway.modbus.adu import crc16, decode, encode
from gateway.modbus.reads import ReadCoils, ReadHoldingRegisters
from gateway.modbus.writes import WriteCoil, WriteCoils, WriteRegister, WriteRegisters
from gateway.sim.factory import make_unit
from tests.sim.wire import Talk

WEG = ("ssw06", "ssw07", "ssw900")


@pytest.mark.parametrize("unit", [1, 247])
def test_w_01_a_frame_goes_to_one_of_247_units(unit: int) -> None:
    assert decode(encode(unit, b"\x03\x00\x02\x00\x01")).unit == unit


def test_w_01_there_is_no_unit_248() -> None:
    with pytest.raises((BadFrameError, ValueError)):
        encode(248, b"\x03\x00\x02\x00\x01")


def test_w_02_the_crc_goes_low_byte_first_and_registers_high_byte_first() -> None:
    frame = encode(1, WriteRegister(0x1234, 0x5678).encode())

    assert frame[2:6] == bytes.fromhex("12345678")
    assert frame[-2:] == crc16(frame[:-2]).to_bytes(2, "little")


@pytest.mark.parametrize("family", ["ssw06", "ssw07"])
def test_w_07_parameter_nnn_is_register_nnn_and_vbnn_is_5000_and_nn(family: str) -> None:
    for row in load_profile(family).parameters.values():
        if row.table is Table.HOLDING:
            first = 5000 if row.code.startswith("VB") else 0
            assert row.address == first + int(row.code.lstrip("PVB"))


def test_w_07_a_register_stands_in_the_request_as_printed() -> None:
    rows = load_profile("ssw900").parameters

    assert ReadHoldingRegisters(rows["S5.1.1"].address, 1).encode().hex() == "0302a80001"  # net id 680


def test_w_08_values_go_as_whole_numbers_without_their_point() -> None:
    profile = load_profile("ssw900")
    row = profile.parameters["C8.2.5.3"]

    assert to_words(profile, row, 9.5) == (95,)
    assert decode_row(profile, Variant(), row, (95,)).value == 9.5


@pytest.mark.parametrize(
    ("family", "pdu", "reply"),
    [
        ("ssw07", "070000", "8701"),  # a function that it does not have
        ("ssw07", "0303210001", "8302"),  # P801, which it does not have
        ("ssw07", "06013a03e8", "8603"),  # P314 = 1000
        ("ssw06", "1603eb00000000", "9601"),
        ("ssw900", "03270f0001", "8302"),  # register 9999
    ],
)
def test_w_09_an_exception_is_the_function_with_bit_7_and_one_code(family: str, pdu: str, reply: str) -> None:
    unit = make_unit(family, 1)

    answer = unit.handle(bytes.fromhex(pdu), 0.0)

    assert answer is not None
    assert answer.hex() == reply


@pytest.mark.parametrize("family", ["ssw06", "ssw07"])
def test_w_10_single_writes_are_echoed_and_long_ones_answered_with_their_quantity(family: str) -> None:
    talk = Talk(make_unit(family, 1))

    assert WriteCoil(107, is_on=True).encode().hex() == "05006bff00"
    assert WriteCoil(107, is_on=False).encode().hex() == "05006b0000"
    for request in (WriteCoil(107, is_on=True), WriteRegister(314, 5)):
        assert talk.pdu(request) == request.encode()
    assert (talk.pdu(WriteRegisters(313, (1, 5))) or b"").hex() == "1001390002"
    assert (talk.pdu(WriteCoils(101, (True, False))) or b"").hex() == "0f00650002"


def test_w_11_the_first_coil_is_the_lowest_bit_and_unused_bits_are_0() -> None:
    talk = Talk(make_unit("ssw07", 1))  # at rest: general enable (1), remote (8) and supply (14)

    assert (talk.pdu(ReadCoils(0, 15)) or b"").hex() == "01020241"
    assert WriteCoils(100, (True, False, True)).encode()[-1] == 0b101
