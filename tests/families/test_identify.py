"""Which family a unit proves to be, by its answers."""

from __future__ import annotations

from typing import Any

import pytest

from gateway.families.devices.device import Identity
from gateway.families.diagnosis.identification import identify, identify_requests, matches
from gateway.families.profile.load import FAMILIES, load_profile
from gateway.modbus.device_id import DeviceIdentification


def weg(product: str, revision: str = "V1.20") -> DeviceIdentification:
    return DeviceIdentification(objects={0: "WEG", 1: product, 2: revision})


def identity(family: str, **answers: Any) -> Identity:
    return identify(load_profile(family), answers)


def sst(model: int = 330, *serial: int, name: bytes | None = None, order: Any = "big") -> dict[str, Any]:
    """Return the answers of an SST: registers 0 to 11, and its name."""
    registers = (model, 0x0106, 0x0204, 1, 0, 0, 0, 0x0101, *(serial or (1, 2, 0, 0)))
    pieces = None if name is None else [name[at : at + 2] for at in range(0, 16, 2)]
    return {"model": registers, "name": pieces and tuple(int.from_bytes(each, order) for each in pieces)}


@pytest.mark.parametrize(
    ("family", "asked"),
    [  # FC43 last, since a device without it may be silent after it; VB00, which only an SSW-06 need have
        ("ssw06", {"register": "03 13 88 00 01", "fc43": "2b 0e 01 00"}),
        ("ssw07", {"register": "03 13 89 00 01", "model": "03 13 88 00 01", "fc43": "2b 0e 01 00"}),
        (  # never half a serial number
            "ssw900",
            {
                "slots": "03 01 4f 00 02",
                "firmware": "03 01 48 00 01",
                "model": "03 01 26 00 06",
                "fc43": "2b 0e 01 00",
            },
        ),
        ("sst", {"model": "04 00 00 00 0c", "name": "04 00 16 00 08"}),
    ],
)
def test_a_unit_is_asked(family: str, asked: dict[str, str]) -> None:
    found = [(one.tag, one.request.encode().hex(" ")) for one in identify_requests(load_profile(family))]

    assert found == list(asked.items())


@pytest.mark.parametrize(
    ("family", "answers", "seen"),
    [
        ("ssw07", {"fc43": weg("SSW-07 85A"), "model": (15,)}, "ssw07"),
        ("ssw07", {"fc43": weg("SSW-08 17A")}, "ssw07"),
        ("ssw07", {"fc43": weg("SSW-06 85.0A")}, "ssw06"),
        ("ssw07", {"register": (0,), "model": (15,)}, "ssw06"),  # an SSW-06 that is silent to function 43
        ("ssw07", {"register": (0,), "model": (7,)}, None),
        *[("ssw07", {"fc43": weg(product)}, None) for product in ("CFW-11", "", "SSW-071")],
        ("ssw06", {"fc43": weg("SSW-06 820A"), "register": (15,)}, "ssw06"),
        ("ssw06", {"fc43": weg("SSW-06 820A"), "register": None}, "ssw06"),
        ("ssw06", {"fc43": None, "register": (15,)}, "ssw06"),
        ("ssw06", {"fc43": weg("SSW-06 85.0A"), "register": (7,)}, None),
        ("ssw06", {"fc43": weg("SSW-07 85A"), "register": (15,)}, "ssw07"),  # a name is not outvoted
        ("ssw06", {"fc43": weg("CFW-11"), "register": (15,)}, None),
        ("ssw900", {"fc43": weg("SSW-07 85A"), "slots": (2, 0)}, "ssw07"),
        ("ssw900", {"fc43": weg("SS"), "slots": (0, 2)}, "ssw900"),
        ("ssw900", {"fc43": weg("SS")}, None),
        *[("ssw900", {"slots": slots}, None) for slots in ((0, 0), (2, 9), (700, 2))],
        ("sst", sst(331), None),
        *[(family, {}, None) for family in FAMILIES],
    ],
)
def test_a_unit_is_of_the_family_that_its_answers_prove(
    family: str, answers: dict[str, Any], seen: str | None
) -> None:
    found = identity(family, **answers)

    assert found.family_seen == seen
    assert found.reason
    assert matches(load_profile(family), found) is (seen == family)


@pytest.mark.parametrize("filling", ["\0\0", "\n", "\x1b[2J", "\x02\x05V1.60", "\xff"])
def test_model_and_firmware_are_printable_characters_only(filling: str) -> None:
    seen = identity("ssw07", fc43=weg(f"SSW-07 85.0A{filling}", f"V1.60{filling}"))

    assert (seen.model, seen.firmware) == ("SSW-07 85.0A", "1.60")


SSW900_SLOTS = {"fc43": weg("SS"), "firmware": (125,), "model": (3, 0, 1, 2, 0x5678, 0x1234)}
RATED_900 = [(0, 0, 10), (1, 7, 105), (6, 21, 1400), (1, 8, None), (7, 7, None), (1, 22, None)]
SERIALS = [((1, 2, 0, 0), str(0x00010002)), ((0, 0, 0, 5), "5"), ((0, 7, 0, 0), "7"), ((0, 0, 0, 0), None)]
IDENTITIES = [  # of a family by its answers, and what they make known
    *[
        (
            "ssw900",
            {"fc43": weg(text, "V1.3")},
            {"model": text, "firmware": "1.3", "slot": None, "serial": None},
        )
        for text in ("SSW900", "SSW-900 85A", "SSW900-K")
    ],
    ("ssw900", {"fc43": weg("SSW900"), "slots": (0, 0)}, {"slot": None, "rated_current_a": None}),
    *[
        ("ssw900", {**SSW900_SLOTS, "slots": slots}, {"slot": slot, "firmware": "1.25"})
        for slots, slot in (((2, 0), 1), ((0, 2), 2), ((8, 2), 2), ((2, 2), None))
    ],
    (
        "ssw900",  # C9.1.1 = 10 A is not of this size
        {**SSW900_SLOTS, "slots": (2, 0)},
        {
            "serial": str(0x12345678),
            "rating": load_profile("ssw900").enums["S3.3.1"][3],
            "rated_current_a": None,
        },
    ),
    ("ssw900", {"slots": (7, 2)}, {"model": "SSW900", "accessories": ("Ethernet", "RS-485")}),
    *[
        ("ssw900", {"slots": (2, 0), "model": (size, current, 0, 0, 1, 0)}, {"rated_current_a": rated_a})
        for size, current, rated_a in RATED_900
    ],
    *[
        ("sst", answers, {"model": model, "firmware": "4.21", "hardware": "6.1"})
        for answers, model in (
            (sst(330), "SST330i"),
            (sst(360), "SST360i"),
            (sst(130), "SST130i"),
            (sst(130, name=b"SST130i-140-M-ES"), "SST130i-140-M-ES"),
            (sst(130, name=b"SST130i-140-M-ES", order="little"), "SST130i-140-M-ES"),
            (sst(330, name=b"SST330i-M".ljust(16, b"\0")), "SST330i-M"),
            (sst(330, name=bytes(16)), "SST330i"),  # no text
            (sst(330, name=b"\xff" * 16), "SST330i"),
        )
    ],
    *[("sst", sst(330, *words), {"serial": serial}) for words, serial in SERIALS],  # four only where used
]


@pytest.mark.parametrize(("family", "answers", "known"), IDENTITIES)
def test_a_starter_is_known_by_what_its_manual_says_of_its_answers(
    family: str, answers: dict[str, Any], known: dict[str, Any]
) -> None:
    seen = identity(family, **answers)

    assert seen.family_seen == family
    assert {name: getattr(seen, name) for name in known} == known
