"""What a starter is, told once and whenever it changes: its points, its commands, who it says it is."""

from __future__ import annotations

from typing import Any

from gateway.families.command import verbs
from gateway.families.identify import Identity
from gateway.families.schema import Profile, Variant
from gateway.starters.admission import OWN_VERBS
from gateway.starters.decoding import type_of, unit_of
from gateway.starters.records import InfoRecord
from gateway.starters.setup import StarterSetup


def info_of(setup: StarterSetup, variant: Variant, identity: Identity) -> InfoRecord:
    """Return the description of a starter as far as it is known."""
    profile = setup.profile
    return InfoRecord(
        starter=setup.name,
        family=profile.family,
        model=variant.model,
        firmware=variant.firmware,
        serial=identity.serial,
        line=setup.line,
        address=setup.address,
        points={name: _describe(profile, name) for name in profile.points},
        commands=(*verbs(profile), *OWN_VERBS),
        hardware=identity.hardware,
        rated_current_a=variant.rated_current_a,
        rating=identity.rating,
        slot=variant.slot,
        accessories=identity.accessories,
    )


def _describe(profile: Profile, name: str) -> dict[str, Any]:
    point = profile.points[name]
    kind = type_of(profile, name)
    labels = profile.enums.get(profile.parameters[point.code].enum, {}) if kind == "enum" else {}
    return {
        "code": point.code or None,
        "unit": unit_of(profile, name),
        "type": kind,
        "enum": {str(value): label for value, label in labels.items()} or None,
        "deadband": point.deadband,
    }
