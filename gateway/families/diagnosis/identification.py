"""Which family answers: what a unit is asked, what its answers prove, and in whose words a stop is sent.

Nothing is taken for granted: a unit that proves nothing has no family. The rows that distinguish a family are
part of each reading on which a command decides. An SSW-07 has none: its status row excludes an SSW900 and an
SST, and its coil 100 means run on an SSW-06 too.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Any

from gateway.contract import Note
from gateway.families.devices import DEVICES, device_of
from gateway.families.devices.device import Identity, Question
from gateway.families.profile.decode import rated_current_a
from gateway.families.profile.load import FAMILIES, load_profile
from gateway.families.profile.procedure import Preparation, Seen
from gateway.families.profile.schema import Profile, Variant
from gateway.families.reading import plan_blocks, with_rows
from gateway.modbus import DeviceIdentification, Request

_PRODUCT, _REVISION = 1, 2  # objects of the basic identification [APP 6.21]


def identify_requests(profile: Profile) -> tuple[Question, ...]:
    """Return what to ask a unit that is configured as this family; any of them may stay without answer."""
    return device_of(profile).questions(profile)


def identify(profile: Profile, answers: Mapping[str, Any]) -> Identity:
    """Return who the unit is; an answer is what `decode_reply` gave, None when there was none."""
    return device_of(profile).identity(profile, _from_text(answers.get("fc43")), answers)


def matches(profile: Profile, identity: Identity) -> bool:
    """Return whether the unit has proved to be of this family."""
    return why_not(profile, identity) is None


def why_not(profile: Profile, identity: Identity) -> str | None:
    """Return in words why the unit must not be taken for this family, None when it has proved to be of it."""
    if identity.lacks:
        return f"it is not {profile.family}: {identity.lacks}"
    if identity.family_seen == profile.family:
        return None
    if identity.family_seen is None:
        return f"not known to be {profile.family}: {identity.reason}"
    return f"it is {identity.family_seen}, not {profile.family}: {identity.reason}"


def slot_trouble(profile: Profile, configured: Variant, seen: Identity) -> str:
    """Return in words where the RS-485 accessory proves to sit, unless as configured; "" where it does."""
    if configured.slot is None or seen.slot in (None, configured.slot):
        return ""
    what = f"slot = {configured.slot} is configured, but the RS-485 accessory sits in slot {seen.slot}"
    rows = " and ".join(device_of(profile).slot_rows)
    return f"{what} by {rows} (set slot = {seen.slot}, or leave it out)"


def candidates() -> tuple[Profile, ...]:
    """Return the families as an unknown unit is asked: those first that name themselves by FC43."""
    order = sorted(DEVICES, key=lambda family: DEVICES[family].product is None)
    return tuple(load_profile(family) for family in order)


def stop_profile(configured: Profile, identity: Identity) -> Profile:
    """Return the family whose words a stop must speak: the proven one where it is known here."""
    seen = identity.family_seen
    return load_profile(seen) if seen in FAMILIES and seen != configured.family else configured


def stop_note(configured: Profile, identity: Identity, spoken: Collection[str]) -> Note | None:
    """Return what the result of a stop says of its words; None where nothing contradicts them.

    `spoken` names the families in whose words it was sent, in their order.
    """
    seen, family = identity.family_seen, configured.family
    if seen == family or (seen is None and not identity.model):
        return None
    if seen not in FAMILIES:
        return Note("stop_to_unknown", reason=identity.reason, configured=family)
    if family not in spoken:
        return Note("stop_as_proved", proved=seen, configured=family)
    if seen in spoken:
        return Note("stop_changed", proved=seen, configured=family)
    return Note("stop_as_configured", proved=seen, configured=family)


def distinctive_rows(profile: Profile) -> tuple[str, ...]:
    """Return the rows that a device of another family does not have, or in which it has other numbers."""
    return device_of(profile).distinctive_rows


def decision_reads(profile: Profile) -> tuple[Request, ...]:
    """Return what commands read before they decide: the state's rows with the distinctive ones."""
    blocks = (block for block in plan_blocks(profile, Variant()) if block.group == "status")
    codes = [code for block in blocks for code in block.codes]
    reads = with_rows(profile, (), (*codes, *distinctive_rows(profile)))
    return tuple(read.request for read in reads)


def contradiction(profile: Profile, seen: Seen) -> str:
    """Return in words how the rows seen deny this family; empty when they do not, or were not seen."""
    codes = distinctive_rows(profile)
    if not seen.keys() >= set(codes) or device_of(profile).is_like(seen):
        return ""
    shown = " and ".join(f"{code} is {seen[code][0]}" for code in codes)
    return f"it is not {profile.family}: {shown}"


def with_distinctive_rows(profile: Profile, preparation: Preparation) -> Preparation:
    """Return a preparation whose reading also shows whether the device is of another family."""
    return replace(preparation, reads=with_rows(profile, preparation.reads, distinctive_rows(profile)))


def _from_text(answer: DeviceIdentification | None) -> Identity:
    """Return what FC43 makes known, of whatever family; the first family that its text names counts."""
    if answer is None:
        return Identity(reason="it does not answer Read Device Identification (FC43)")
    text = _printable(answer.objects.get(_PRODUCT, ""))
    revision = _printable(answer.objects.get(_REVISION, "")).removeprefix("V") or None
    patterns = {family: device.product for family, device in DEVICES.items()}
    places = {
        found.start(): family
        for family, pattern in patterns.items()
        if pattern is not None and (found := pattern.search(text))
    }
    if not places:
        return Identity(model=text or None, firmware=revision, reason=f"FC43 names {text or 'no product'!r}")
    family = places[min(places)]
    return Identity(
        family_seen=family,
        model=text,
        firmware=revision,
        rated_current_a=rated_current_a(text) if DEVICES[family].is_current_named else None,
        reason=f"FC43 names {text!r}",
    )


def _printable(text: str) -> str:
    return "".join(itertools.takewhile(lambda each: each.isascii() and each.isprintable(), text)).strip()
