"""FC43: what an identification says, also one with the wrong lengths that the manuals print."""

from __future__ import annotations

from typing import Any

import pytest

from gateway.errors import BadReplyError
from tests.modbus.samples import fc

BASIC: Any = fc(43)


@pytest.mark.parametrize(
    ("tail", "objects"),
    [
        *[
            (f"{conformity} 00 00 01 00 03 57 45 47", {0: "WEG"})
            for conformity in ("00", "01", "51", "81", "FF")
        ],
        ("81 00 00 02 00 00 01 01 41", {0: "", 1: "A"}),
        # an object that runs past the end keeps its printable characters, and the next begins after them
        ("81 00 00 01 01 14 53 53 57 2D 30 36", {1: "SSW-06"}),
        ("81 00 00 02 01 14 53 53 57 02 05 56 31 2E 31 31", {1: "SSW", 2: "V1.11"}),
        ("81 00 00 03 00 03 57 45 47 01", {0: "WEG"}),  # announced, but missing
        ("81 00 00 02 01 14 20 7E 7F 01 41", {1: " ~", 0x7F: "A"}),
        ("81 00 00 01 01 09", {1: ""}),
        (  # 13 characters, and the manual's length of 14h, which swallows no other object (ssw06-es 5.4.7)
            "81 00 00 03 00 03 57 45 47 01 14" + b"SSW-06 100.0A".hex() + "02 05" + b"V1.60".hex(),
            {0: "WEG", 1: "SSW-06 100.0A", 2: "V1.60"},
        ),
    ],
)
def test_objects_are_read(tail: str, objects: dict[int, str]) -> None:
    said = BASIC.decode_reply(bytes.fromhex("2B 0E 01 " + tail))

    assert said.objects == objects


@pytest.mark.parametrize(
    "pdu",
    [
        "2B 0E 01 81 00 00",  # no number of objects
        "2B 0D 01 81 00 00 00",  # another interface
        "2B 0E 01 81 00 00 01 00 03 57 45 47 00",  # bytes after the last object
        "2B 0E 01 81 00 00 01 01 09 00 00",  # an object that runs past the end is not even text
    ],
)
def test_what_is_no_identification_is_refused(pdu: str) -> None:
    with pytest.raises(BadReplyError):
        BASIC.decode_reply(bytes.fromhex(pdu))
