"""What all WEG starters share (W-xx), judged by bytes against the simulated ones."""

from __future__ import annotations

import pytest

from gateway.families.profile.decode import decode_row
from gateway.families.profile.load import load_profile
from gateway.families.profile.parameters import to_words
from gateway.families.profile.rows import Table
from gateway.families.profile.schema import Variant
from gateway.modbus.reads import ReadHoldingRegisters
from gateway.sim.factory import make_unit

WEG = ("ssw06", "ssw07", "ssw900")


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
