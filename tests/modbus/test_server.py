"""What a simulated unit answers to a request that is none."""

from __future__ import annotations

import pytest

from gateway.errors import BadRequestError
from gateway.modbus.server import decode_request
from tests.modbus.samples import fc

REFUSED = {  # the exception's code for each; an impossible quantity is judged before the address
    "a function that no starter has": (1, "07, 83 02, 2B 0D 01 00, 2B"),
    "an impossible quantity": (3, "01 00 00 00 00, 02 00 00 07 D1, 03 FF FF 00 7E, 10 00 00 00 00 00"),
    "a wrong length": (
        3,
        "03 00 00 00, 06 00 00 00 01 00, 0F 00 00 00 01 01, 10 00 00 00 01 02 00, 2B 0E 01",
    ),
    "a byte count that does not fit the quantity": (3, "0F 00 00 00 09 01 00, 10 00 00 00 01 01 00"),
    "a coil that is neither FF00 nor 0000": (3, "05 00 64 00 01, 05 00 64 FF FF"),
    "an unknown read code": (3, "2B 0E 00 00, 2B 0E 05 00"),
    "a run beyond the last address": (
        2,
        "01 FF FF 00 02, 0F FF FF 00 02 01 03, 10 FF FF 00 02 04 00 00 00 00",
    ),
}


@pytest.mark.parametrize("why", REFUSED)
def test_a_request_that_is_none_is_answered_with_the_exception_for_it(why: str) -> None:
    code, pdus = REFUSED[why]
    for pdu in pdus.split(","):
        with pytest.raises(BadRequestError) as error:
            decode_request(bytes.fromhex(pdu))
        assert error.value.exception_code == code, pdu


def test_bits_that_fill_up_the_last_byte_are_ignored() -> None:
    assert decode_request(bytes.fromhex("0F 00 64 00 02 01 FF")) == fc(15, 100, (True, True))
