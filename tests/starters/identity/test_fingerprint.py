"""The fingerprint of a starter: how another differs from it, and which configured models contradict it."""

from __future__ import annotations

import pytest

from gateway.starters.identity.fingerprint import (
    FIELDS,
    Fingerprint,
    completed,
    contradicts,
    differences,
)

PUMP = Fingerprint(None, "1.60", "ssw07", "SSW-07 85.0A", "85 A")
SST, NAMED = Fingerprint(model="SST330i"), Fingerprint(model="SST330i-M-ES")


@pytest.mark.parametrize(
    ("known", "seen", "fields"),
    [
        *((PUMP, Fingerprint(**{**PUMP.as_data(), name: "other"}), (name,)) for name in FIELDS[1:]),
        (Fingerprint("77"), Fingerprint("78"), ("serial",)),
        (PUMP, Fingerprint("4711", family="ssw07"), ()),  # what one of them does not know
        (Fingerprint(), PUMP, ()),
        (SST, NAMED, ()),  # the type is all that register 0 of an SST says
        (Fingerprint(model="SST130i"), Fingerprint(model="SST130i-75-M"), ()),
        (Fingerprint(model="SST360i"), NAMED, ("model",)),
        (Fingerprint(model="SST330i-M"), NAMED, ("model",)),
        (Fingerprint(model="SSW"), PUMP, ("model",)),
    ],
)
def test_what_both_say_otherwise_is_a_difference(
    known: Fingerprint, seen: Fingerprint, fields: tuple[str, ...]
) -> None:
    assert differences(known, seen) == differences(seen, known) == fields


@pytest.mark.parametrize(
    ("seen", "known", "after"),
    [
        (SST, NAMED, NAMED),  # a name that was known is not forgotten for the type
        (NAMED, SST, NAMED),
        (
            Fingerprint("4711", family="ssw07", model="SSW-07 85.0A"),
            PUMP,
            Fingerprint("4711", "1.60", "ssw07", "SSW-07 85.0A", "85 A"),
        ),
    ],
)
def test_what_is_not_said_now_is_taken_from_before(
    seen: Fingerprint, known: Fingerprint, after: Fingerprint
) -> None:
    assert completed(seen, known) == after


@pytest.mark.parametrize(
    ("configured", "model", "current", "is_contradiction"),
    [
        (None, "SSW-07 85.0A", "85 A", False),
        ("SSW-07 85A", None, None, False),
        ("SSW-07 85A", "SSW-07 85.0A", "85 A", False),  # it may be spelt otherwise
        ("ssw07 85A", "SSW-07 85.0A", "85 A", False),
        ("SSW 07", "SSW-07 85.0A", "85 A", False),
        ("SSW-06 820A", "SSW-06 820.0A", "820 A", False),
        ("SSW-08", "something of its own", None, False),
        ("SSW900 105A", "SSW900", "45 to 105 A", False),
        ("SSW900 105A", "SSW-900 K", None, False),
        ("SST330i", "SST330i-75", None, False),
        ("SST330i-75", "SST330i", None, False),
        ("pump of 85A", "SSW-07 85.0A", "85 A", False),
        ("SSW-07 130A", "SSW-07 85.0A", "85 A", True),  # another series or current
        ("SSW-06 85A", "SSW-07 85.0A", "85 A", True),
        ("SSW-08", "SSW-07 85.0A", "85 A", True),
        ("SSW900 130A", "SSW900", "45 to 105 A", True),
        ("SST330i-75", "SST330i-30", None, True),
        ("SST330i", "SST360i", None, True),
    ],
)
def test_another_series_or_current_contradicts_the_configured_model(
    configured: str | None, model: str | None, current: str | None, *, is_contradiction: bool
) -> None:
    assert contradicts(configured, Fingerprint(model=model, rated_current=current)) is is_contradiction
