from __future__ import annotations

from typing import Any

import pytest

from gateway.families.devices.device import Identity
from gateway.families.diagnosis.identify import identify, identify_requests, matches, why_not
from gateway.families.profile.load import load_profile
from gateway.families.profile.schema import Variant
from gateway.modbus.device_id import DeviceIdentification
from gateway.starters.setup import StarterSetup, merged
from gateway.starters.telemetry.description import info_of

SST_NAME = b"SST130i-140-M-ES"


def weg(product: str, revision: str = "V1.20") -> DeviceIdentification:
    return DeviceIdentification(objects={0: "WEG", 1: product, 2: revision})


def identity(family: str, **answers: Any) -> Identity:
    return identify(load_profile(family), answers)


def frames(family: str) -> dict[str, str]:
    return {one.tag: one.request.encode().hex(" ") for one in identify_requests(load_profile(family))}


def test_an_ssw07_is_asked_for_a_register_that_every_one_has() -> None:
    assert frames("ssw07") == {
        "register": "03 13 89 00 01",
        "model": "03 13 88 00 01",  # which only an SSW-06 need have
        "fc43": "2b 0e 01 00",
    }


@pytest.mark.parametrize("family", ["ssw06", "ssw07", "ssw900"])
def test_fc43_is_asked_last_since_a_device_without_it_may_be_silent_after_it(family: str) -> None:
    assert list(frames(family))[-1] == "fc43"


def test_an_ssw06_that_is_silent_to_function_43_is_no_ssw07() -> None:
    assert identity("ssw07", register=(0,), model=(15,)).family_seen == "ssw06"
    assert identity("ssw07", register=(0,), model=(7,)).family_seen is None
    assert identity("ssw07", fc43=weg("SSW-07 85A"), model=(15,)).family_seen == "ssw07"


@pytest.mark.parametrize("family", ["ssw06", "ssw07"])
def test_a_device_that_names_itself_as_no_known_starter_is_of_another_family(family: str) -> None:
    seen = identity(family, fc43=weg("CFW-11"), register=(15,))

    assert why_not(load_profile(family), seen).startswith(f"it is not {family}: FC43 names 'CFW-11'")  # type: ignore[union-attr]
    assert not identity(family, fc43=weg("")).lacks  # no name says nothing


def test_an_ssw900_of_unknown_text_is_another_only_by_its_slots_too() -> None:
    assert identity("ssw900", fc43=weg("SS"), slots=(0, 0)).lacks
    assert not identity("ssw900", fc43=weg("SS")).lacks
    assert not identity("ssw900", fc43=weg("SS"), slots=(0, 2)).lacks


def test_an_ssw06_is_asked_for_its_fixed_register_too() -> None:
    assert frames("ssw06") == {"fc43": "2b 0e 01 00", "register": "03 13 88 00 01"}


def test_an_ssw900_is_asked_for_its_slots_and_never_for_half_a_serial_number() -> None:
    assert frames("ssw900") == {
        "fc43": "2b 0e 01 00",
        "slots": "03 01 4f 00 02",
        "firmware": "03 01 48 00 01",
        "model": "03 01 26 00 06",
    }


def test_an_sst_is_asked_for_registers_with_function_4() -> None:
    assert frames("sst") == {"model": "04 00 00 00 0c", "name": "04 00 16 00 08"}


@pytest.mark.parametrize(
    ("text", "current_a"),
    [
        ("SSW-07 85.0A", 85.0),
        ("SSW-07 85A", 85.0),
        ("SSW-08 17A", 17.0),
        ("SSW-07", None),
        ("SSW-07 17,5A", 17.5),
    ],
)
def test_an_ssw07_or_ssw08_is_known_by_the_text_of_object_1(text: str, current_a: float | None) -> None:
    seen = identity("ssw07", fc43=weg(text))

    assert (seen.family_seen, seen.model, seen.firmware) == ("ssw07", text, "1.20")
    assert seen.rated_current_a == current_a
    assert matches(load_profile("ssw07"), seen)


@pytest.mark.parametrize("register", [(15,), None])
def test_an_ssw06_is_known_by_its_text(register: tuple[int, ...] | None) -> None:
    seen = identity("ssw06", fc43=weg("SSW-06 820A"), register=register)

    assert (seen.family_seen, seen.rated_current_a) == ("ssw06", 820.0)


def test_an_ssw06_that_is_silent_to_function_43_is_known_by_its_fixed_register() -> None:
    seen = identity("ssw06", fc43=None, register=(15,))

    assert (seen.family_seen, seen.model, seen.rated_current_a) == ("ssw06", None, None)


def test_an_ssw06_whose_fixed_register_is_not_15_is_not_believed() -> None:
    seen = identity("ssw06", fc43=weg("SSW-06 85.0A"), register=(7,))

    assert seen.family_seen is None
    assert why_not(load_profile("ssw06"), seen) == (
        "it is not ssw06: FC43 names 'SSW-06 85.0A'; VB00 is 7 and should be 15"
    )


def test_the_fixed_register_does_not_outvote_another_name() -> None:
    assert identity("ssw06", fc43=weg("SSW-07 85A"), register=(15,)).family_seen == "ssw07"
    assert identity("ssw06", fc43=weg("CFW-11"), register=(15,)).family_seen is None


def test_an_ssw06_where_an_ssw07_is_configured_is_reported_by_name() -> None:
    profile = load_profile("ssw07")
    seen = identity("ssw07", fc43=weg("SSW-06 85.0A"))

    assert not matches(profile, seen)
    assert why_not(profile, seen) == "it is ssw06, not ssw07: FC43 names 'SSW-06 85.0A'"


def test_a_unit_that_proves_nothing_has_no_family() -> None:
    for family in ("ssw06", "ssw07", "ssw900", "sst"):
        seen = identity(family)

        assert seen.family_seen is None
        assert not matches(load_profile(family), seen)
        assert seen.reason


@pytest.mark.parametrize("product", ["CFW-11", "", "SSW-071"])
def test_an_unknown_product_has_no_family(product: str) -> None:
    seen = identity("ssw07", fc43=weg(product))

    assert (seen.family_seen, seen.model) == (None, product or None)


@pytest.mark.parametrize("text", ["SSW900", "SSW-900 85A", "SSW900-K"])
def test_an_ssw900_is_known_by_its_text_whatever_else_it_says(text: str) -> None:
    seen = identity("ssw900", fc43=weg(text, "V1.3"))

    assert (seen.family_seen, seen.model, seen.firmware, seen.slot) == ("ssw900", text, "1.3", None)
    assert (seen.rated_current_a, seen.serial) == (None, None)


@pytest.mark.parametrize(("slots", "slot"), [((2, 0), 1), ((0, 2), 2), ((8, 2), 2), ((2, 2), None)])
def test_an_ssw900_whose_text_is_not_known_is_known_by_the_accessory_in_its_slots(
    slots: tuple[int, int], slot: int | None
) -> None:
    seen = identity(
        "ssw900", fc43=weg("SS"), slots=slots, firmware=(125,), model=(3, 0, 1, 2, 0x5678, 0x1234)
    )

    assert (seen.family_seen, seen.slot, seen.firmware) == ("ssw900", slot, "1.25")
    assert seen.serial == str(0x12345678)
    assert identity("ssw900", slots=slots).model == "SSW900"


@pytest.mark.parametrize("slots", [(0, 0), (2, 9), (700, 2)])
def test_slots_without_an_rs485_accessory_prove_nothing(slots: tuple[int, int]) -> None:
    assert identity("ssw900", slots=slots).family_seen is None


def test_a_named_ssw900_without_a_clear_slot_has_no_slot() -> None:
    assert identity("ssw900", fc43=weg("SSW900"), slots=(0, 0)).slot is None


def test_plausible_slots_do_not_outvote_another_name() -> None:
    seen = identity("ssw900", fc43=weg("SSW-07 85A"), slots=(2, 0))

    assert (seen.family_seen, seen.slot) == ("ssw07", None)


def sst_registers(
    model: int = 330, serial: tuple[int, int, int, int] = (0x0001, 0x0002, 0, 0)
) -> tuple[int, ...]:
    return (model, 0x0106, 0x0204, 0x0001, 0, 0, 0, 0x0101, *serial)


@pytest.mark.parametrize(("number", "model"), [(330, "SST330i"), (360, "SST360i"), (130, "SST130i")])
def test_an_sst_is_known_by_its_model_number(number: int, model: str) -> None:
    seen = identity("sst", model=sst_registers(number), name=None)

    assert (seen.family_seen, seen.model, seen.firmware) == ("sst", model, "4.21")
    assert seen.serial == str(0x00010002)
    assert matches(load_profile("sst"), seen)


def test_another_model_number_is_no_sst() -> None:
    assert identity("sst", model=sst_registers(331)).family_seen is None


@pytest.mark.parametrize("order", ["big", "little"])
def test_the_full_name_of_an_sst_is_read_in_either_byte_order(order: Any) -> None:
    name = tuple(int.from_bytes(SST_NAME[at : at + 2], order) for at in range(0, 16, 2))

    assert identity("sst", model=sst_registers(130), name=name).model == "SST130i-140-M-ES"


def test_a_short_name_ends_at_its_padding() -> None:
    text = b"SST330i-M".ljust(16, b"\0")
    name = tuple(int.from_bytes(text[at : at + 2], "big") for at in range(0, 16, 2))

    assert identity("sst", model=sst_registers(), name=name).model == "SST330i-M"


@pytest.mark.parametrize("word", [0, 0xFFFF])
def test_a_name_that_is_no_text_leaves_the_model_number(word: int) -> None:
    assert identity("sst", model=sst_registers(), name=(word,) * 8).model == "SST330i"


def test_the_serial_number_of_an_sst_takes_four_registers_only_when_they_are_used() -> None:
    assert identity("sst", model=sst_registers(serial=(0, 0, 0, 5))).serial == "5"
    assert identity("sst", model=sst_registers(serial=(0, 7, 0, 0))).serial == "7"
    assert identity("sst", model=sst_registers(serial=(0, 0, 0, 0))).serial is None


def test_what_info_says_of_hardware_rating_and_accessories_is_the_devices_own() -> None:
    sst = identity("sst", model=sst_registers())
    ssw900 = identity("ssw900", slots=(7, 2), model=(3, 0, 1, 2, 0x5678, 0x1234))

    assert sst.hardware == "6.1"
    assert ssw900.accessories == ("Ethernet", "RS-485")
    assert (ssw900.slot, ssw900.rating) == (2, load_profile("ssw900").enums["S3.3.1"][3])


def test_info_gives_them_and_the_rated_current() -> None:
    ssw07 = Identity(family_seen="ssw07", rated_current_a=85.0, hardware="6.1", accessories=("RS-485", "CAN"))
    setup = StarterSetup("p", "l", 1, load_profile("ssw07"), Variant())

    info = info_of(setup, merged(setup.variant, ssw07), ssw07)

    assert (info.rated_current_a, info.hardware, info.accessories) == (85.0, "6.1", ("RS-485", "CAN"))


@pytest.mark.parametrize("filling", ["\0\0", "\n", "\x1b[2J", "\x02\x05V1.60", "\xff"])
def test_model_and_firmware_are_printable_characters_only(filling: str) -> None:
    objects = {0: "WEG", 1: f"SSW-07 85.0A{filling}", 2: f"V1.60{filling}"}

    seen = identity("ssw07", fc43=DeviceIdentification(objects))

    assert (seen.model, seen.firmware) == ("SSW-07 85.0A", "1.60")
