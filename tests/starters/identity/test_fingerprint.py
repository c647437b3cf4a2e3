from __future__ import annotations

import pytest

from gateway.families.devices.device import Identity
from gateway.starters.identity.fingerprint import (
    FIELDS,
    Fingerprint,
    completed,
    contradicts,
    differences,
    fingerprint_of,
)

PUMP = Fingerprint(None, "1.60", "ssw07", "SSW-07 85.0A", "85 A")


def test_the_fingerprint_of_a_starter_is_what_it_says_of_itself() -> None:
    identity = Identity("ssw07", "SSW-07 85.0A", "1.60", rated_current_a=85.0)

    assert fingerprint_of(identity) == PUMP


def test_an_ssw900_says_its_size_instead_of_its_current() -> None:
    identity = Identity("ssw900", "SSW900", "1.20", "77", rating="45 to 105 A")

    assert fingerprint_of(identity) == Fingerprint("77", "1.20", "ssw900", "SSW900", "45 to 105 A")


@pytest.mark.parametrize("field", FIELDS)
def test_each_field_that_says_something_else_is_a_difference(field: str) -> None:
    known = Fingerprint("a", "b", "c", "d", "e")

    seen = Fingerprint(**{**known.as_data(), field: "other"})

    assert differences(known, seen) == (field,)


def test_what_one_of_them_does_not_know_makes_no_difference() -> None:
    assert differences(PUMP, Fingerprint("4711", family="ssw07")) == ()
    assert differences(Fingerprint(), PUMP) == ()


@pytest.mark.parametrize(
    ("one", "other", "is_different"),
    [
        ("SST330i", "SST330i-M-ES", False),  # the first is all that register 0 says
        ("SST130i", "SST130i-75-M", False),
        ("SST360i", "SST330i-M-ES", True),
        ("SST330i-M", "SST330i-M-ES", True),
        ("SSW", "SSW-07 85.0A", True),
    ],
)
def test_an_sst_that_says_its_type_alone_may_have_any_name_of_that_type(
    one: str, other: str, is_different: bool
) -> None:
    found = differences(Fingerprint(model=one), Fingerprint(model=other))

    assert found == differences(Fingerprint(model=other), Fingerprint(model=one))
    assert found == (("model",) if is_different else ())


def test_a_name_that_was_known_is_not_forgotten_for_the_type() -> None:
    assert completed(Fingerprint(model="SST330i"), Fingerprint(model="SST330i-M")).model == "SST330i-M"
    assert completed(Fingerprint(model="SST330i-M"), Fingerprint(model="SST330i")).model == "SST330i-M"


def test_what_is_not_said_now_is_taken_from_before() -> None:
    seen = Fingerprint("4711", family="ssw07", model="SSW-07 85.0A")

    assert completed(seen, PUMP) == Fingerprint("4711", "1.60", "ssw07", "SSW-07 85.0A", "85 A")


@pytest.mark.parametrize(
    ("configured", "model", "current"),
    [
        (None, "SSW-07 85.0A", "85 A"),
        ("SSW-07 85A", None, None),
        ("SSW-07 85A", "SSW-07 85.0A", "85 A"),
        ("ssw07 85A", "SSW-07 85.0A", "85 A"),
        ("SSW 07", "SSW-07 85.0A", "85 A"),
        ("SSW-06 820A", "SSW-06 820.0A", "820 A"),
        ("SSW-08", "something of its own", None),
        ("SSW900 105A", "SSW900", "45 to 105 A"),
        ("SSW900 105A", "SSW-900 K", None),
        ("SST330i", "SST330i-75", None),
        ("SST330i-75", "SST330i", None),
        ("pump of 85A", "SSW-07 85.0A", "85 A"),
    ],
)
def test_a_configured_model_may_be_spelt_otherwise(
    configured: str | None, model: str | None, current: str | None
) -> None:
    assert not contradicts(configured, Fingerprint(model=model, rated_current=current))


@pytest.mark.parametrize(
    ("configured", "model", "current"),
    [
        ("SSW-07 130A", "SSW-07 85.0A", "85 A"),
        ("SSW-06 85A", "SSW-07 85.0A", "85 A"),
        ("SSW-08", "SSW-07 85.0A", "85 A"),
        ("SSW900 130A", "SSW900", "45 to 105 A"),
        ("SST330i-75", "SST330i-30", None),
        ("SST330i", "SST360i", None),
    ],
)
def test_another_series_or_current_contradicts_the_configuration(
    configured: str, model: str, current: str | None
) -> None:
    assert contradicts(configured, Fingerprint(model=model, rated_current=current))
