"""What a starter is delivered with, as far as its serial manual prints it."""

from __future__ import annotations

from collections.abc import Mapping

from gateway.families.diagnosis.findings import Settings
from gateway.families.profile.schema import Profile, Variant
from gateway.families.profile.word_types import to_number_words


def factory_settings(profile: Profile) -> dict[str, tuple[int, ...]]:
    """Return the words of each row whose factory setting is printed, by code."""
    return {
        row.code: to_number_words(row, row.factory)
        for row in profile.parameters.values()
        if row.factory is not None
    }


def as_delivered(profile: Profile, variant: Variant, rows: Mapping[str, tuple[int, ...]]) -> str:
    """Return in a sentence which of these rows (raw words by code) stand as delivered; "" when none does."""
    settings = Settings(profile, variant, rows)
    factory = factory_settings(profile)
    same = [settings.shown(code) for code in rows if code in factory and rows[code] == factory[code]]
    return f"as delivered: {', '.join(same)}" if same else ""
