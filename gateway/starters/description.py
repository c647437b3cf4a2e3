"""What a starter is, for those who read its topics: its family, its points and its commands."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gateway.contract import OWN_VERBS, InfoRecord
from gateway.families import Identity, Profile, Variant, command, meaning_of, once_per_profile, printed_name
from gateway.starters.own_points import OwnPoint, own_points
from gateway.starters.setup import StarterSetup
from gateway.starters.state import type_of, unit_of


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
        points=_descriptions(profile),
        commands=(*command.verbs(profile), *OWN_VERBS),
        hardware=identity.hardware,
        rated_current_a=variant.rated_current_a,
        rating=identity.rating,
        slot=variant.slot,
        accessories=identity.accessories or None,
        title=setup.title,
    )


def _describe(profile: Profile, name: str) -> dict[str, Any]:
    point = profile.points[name]
    kind = type_of(profile, name)
    labels = profile.enums.get(profile.parameters[point.code].enum, {}) if kind == "enum" else {}
    period = {} if point.every_s is None else {"every_s": point.every_s}
    return {
        "code": point.code or None,
        "name": printed_name(profile, name),
        "meaning": meaning_of(profile, name),
        "unit": unit_of(profile, name),
        "type": kind,
        "enum": {str(value): label for value, label in labels.items()} or None,
        "deadband": point.deadband,
        **period,
    }


def _describe_own(point: OwnPoint) -> dict[str, Any]:
    """Return what is said of one of the gateway's own points: no row of the starter is read for it."""
    name = point.name.replace("_", " ")
    said = {"code": None, "name": name, "meaning": point.meaning, "unit": point.unit, "type": point.type}
    return {**said, "enum": None, "deadband": 0.0}


@once_per_profile
def _descriptions(profile: Profile) -> Mapping[str, Mapping[str, Any]]:
    own = {point.name: _describe_own(point) for point in own_points(profile)}
    return {name: _describe(profile, name) for name in profile.points} | own
