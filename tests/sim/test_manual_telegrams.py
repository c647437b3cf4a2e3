"""The example telegrams of the manuals, answered byte for byte (S7-1 ff. and S6-1 ff. are their examples)."""

from __future__ import annotations

import pytest

from gateway.sim.core.unit import SimulatedUnit
from gateway.sim.factory import make_unit
from tests.sim.wire import Talk


def example_device(family: str, address: int, firmware: str) -> SimulatedUnit:
    """The manuals' device: 85 A, the motor at 50.0 % and 40.0 A."""
    unit = make_unit(family, address, model="85.0A", firmware=firmware)
    unit.fixed.update({2: 500, 3: 400})  # type: ignore[attr-defined]  # both families have it
    return unit


SSW07 = [
    ("status bits 0-1", "01 01 00 00 00 02 BD CB", "01 01 01 02 D0 49"),
    ("P002, P003", "01 03 00 02 00 02 65 CB", "01 03 04 01 F4 01 90 BB C1"),
    ("reset by coil", "01 05 00 6B FF 00 FD E6", "01 05 00 6B FF 00 FD E6"),
    ("VB03 = 0003h", "03 06 13 8B 00 03 BC 87", "03 06 13 8B 00 03 BC 87"),
    ("coils 100-101", "14 0F 00 64 00 02 01 03 2E 6D", "14 0F 00 64 00 02 97 10"),
    ("P313, P314", "0F 10 01 39 00 02 04 00 02 00 05 68 6A", "0F 10 01 39 00 02 91 17"),
    (  # the printed CRC fits no frame: the right one for the printed bytes
        "identification",
        "01 2B 0E 01 00 70 77",
        "01 2B 0E 01 51 00 00 03 00 03"
        " 57 45 47 01 0C 53 53 57 2D 30 37 20 38 35 2E 30 41 02 05 56 31 2E 32 30 70 A8",
    ),
    ("a parameter that is none", "01 06 00 59 00 00 59 D9", "01 86 02 C3 A1"),
]

SSW06 = [
    ("status bits 1-2", "01 01 00 01 00 02 EC 0B", "01 01 01 01 90 48"),  # printed with the CRC of 02h
    ("P002, P003", "01 03 00 02 00 02 65 CB", "01 03 04 01 F4 01 90 BB C1"),
    ("reset by coil", "01 05 00 6B FF 00 FD E6", "01 05 00 6B FF 00 FD E6"),
    ("VB03 = 0303h", "03 06 13 8B 03 03 BC 77", "03 06 13 8B 03 03 BC 77"),
    ("coils 100-101", "14 0F 00 64 00 02 01 03 2E 6D", "14 0F 00 64 00 02 97 10"),
    ("VB09, VB10", "0F 10 13 91 00 02 04 1F FF 0F FF A4 83", "0F 10 13 91 00 02 15 8F"),
    (  # printed with a length of 20 for a text of 12 characters
        "identification",
        "01 2B 0E 01 00 70 77",
        "01 2B 0E 01 81 00 00 03 00 03"
        " 57 45 47 01 0C 53 53 57 2D 30 36 20 38 35 2E 30 41 02 05 56 31 2E 31 31 3D 59",
    ),
    ("a parameter that is none", "01 06 00 59 00 00 59 D9", "01 86 02 C3 A1"),
]


@pytest.mark.parametrize(
    ("request_hex", "reply_hex"), [each[1:] for each in SSW07], ids=[each[0] for each in SSW07]
)
def test_the_ssw07_answers_as_in_its_manual(request_hex: str, reply_hex: str) -> None:
    unit = example_device("ssw07", int(request_hex[:2], 16), "1.20")

    assert Talk(unit).frame(request_hex) == reply_hex


@pytest.mark.parametrize(
    ("request_hex", "reply_hex"), [each[1:] for each in SSW06], ids=[each[0] for each in SSW06]
)
def test_the_ssw06_answers_as_in_its_manual(request_hex: str, reply_hex: str) -> None:
    unit = example_device("ssw06", int(request_hex[:2], 16), "1.11")

    assert Talk(unit).frame(request_hex) == reply_hex
