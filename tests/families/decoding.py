"""Short ways to decode, for tests."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from gateway.families.profile.decode import Decoded, decode_points, decode_row, decode_words
from gateway.families.profile.load import load_profile
from gateway.families.profile.parameters import find
from gateway.families.profile.rows import Table
from gateway.families.profile.schema import Variant

UNKNOWN = Variant()


def decoded(family: str, code: str, *words: int, **known: Any) -> Decoded:
    """Return what a row says; `known` is the starter's variant."""
    profile = load_profile(family)
    found = decode_row(profile, Variant(**known), find(profile, code), words)
    assert found.raw == words
    return found


def value(family: str, code: str, *words: int, **known: Any) -> Any:
    return decoded(family, code, *words, **known).value


def points(family: str, rows: dict[str, tuple[int, ...]], **known: Any) -> dict[str, Any]:
    found = decode_points(load_profile(family), Variant(**known), rows)
    return {name: one.value for name, one in found.items()}


def shown(family: str, table: Table, start: int, words: Sequence[int], **known: Any) -> dict[str, Any]:
    return decode_words(load_profile(family), Variant(**known), table, start, words)
