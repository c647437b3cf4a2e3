"""Short ways to decode, for tests."""

from __future__ import annotations

from typing import Any

from gateway.families.profile.decode import decode_row
from gateway.families.profile.load import load_profile
from gateway.families.profile.parameters import find
from gateway.families.profile.schema import Variant

UNKNOWN = Variant()


def value(family: str, code: str, *words: int, variant: Variant = UNKNOWN) -> Any:
    profile = load_profile(family)
    decoded = decode_row(profile, variant, find(profile, code), words)
    assert decoded.raw == words
    return decoded.value
