"""WEG SSW900 with its RS-485 accessory: slots, menu C3, F128 and A128 [ssw900]."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal

from gateway.families.devices.device import (
    Device,
    Identity,
    Question,
    alarm,
    denied_by_name,
    unnumbered,
)
from gateway.families.devices.findings import (
    Remark,
    Settings,
    Topic,
    Watchdog,
    Weight,
    is_one_of,
    sources,
    start,
    unread,
)
from gateway.families.profile.decode import alarm_code
from gateway.families.profile.procedure import Seen
from gateway.families.profile.rows import Alarm
from gateway.families.profile.schema import Profile, Variant
from gateway.modbus import ReadHoldingRegisters

_SLOT_CONTENTS = range(9)  # S3.5.1, S3.5.2: 0 without .. 8 external current acquisition [table A.2]
_RS485 = 2
_FAULT, _ALARM = 1, 2  # C8.2.5.1
_ALARM_ACTIONS = {  # C8.2.5.2, carried out through the command word of the accessory's slot
    1: "raises alarm A128 and stops the motor by ramp",
    2: "raises alarm A128 and disables the motor, which coasts",
    3: "raises alarm A128 and changes to local",
    4: "raises alarm A128 and changes to remote",
}


class Ssw900Device(Device):
    """SSW900; the text of its FC43 is not printed [7.1]."""

    product = re.compile(r"SSW[- ]?900(?![0-9])", re.IGNORECASE)
    is_current_named = False
    slot_rows = ("S3.5.1", "S3.5.2")
    distinctive_rows = slot_rows
    start_rows = ("C3.1", "C3.2", "C3.3", *slot_rows)
    source_rows = ("C3.2", "C3.3")
    watchdog_rows = ("C8.2.5.1", "C8.2.5.2", "C8.2.5.3")
    watchdog_action = "C8.2.5.2"
    counter_rows = ("S5.4.2", "S5.4.3", "S5.4.4", "S5.4.5")

    def questions(self, profile: Profile) -> tuple[Question, ...]:
        """The slots' contents, the firmware, S3.3.1 to S3.3.4 with C9.1.1 between them, and FC43.

        The serial number's two words must stay together [7.3].
        """
        row = profile.parameters
        return (
            Question("slots", ReadHoldingRegisters(row["S3.5.1"].address, 2), is_always_there=True),
            Question("firmware", ReadHoldingRegisters(row["S3.2.1"].address, 1)),
            Question("model", ReadHoldingRegisters(row["S3.3.1"].address, 6)),
            *super().questions(profile),
        )

    def identity(self, profile: Profile, seen: Identity, answers: Mapping[str, Any]) -> Identity:
        """FC43 proves it, or two slots with plausible contents of which one is the RS-485 accessory."""
        slots = answers.get("slots") or ()
        is_plausible = _are_slots(slots)
        is_named_otherwise = seen.family_seen not in (None, profile.family)
        if is_named_otherwise or not (seen.family_seen or is_plausible):
            return denied_by_name(seen) if slots else seen  # without them the name may be its own
        firmware, model = answers.get("firmware"), answers.get("model")
        return replace(
            seen,
            family_seen=profile.family,
            model=seen.model or "SSW900",
            firmware=seen.firmware if firmware is None else f"{firmware[0] / 100:.2f}",
            serial=None if model is None else str(model[4] | model[5] << 16),  # S3.3.4, low word first
            rating=None if model is None else profile.enums["S3.3.1"].get(model[0]),
            rated_current_a=None if model is None else _rated_current_a(profile, *model[:2]),
            slot=_slot(slots),
            accessories=tuple(profile.enums["S3.5.1"].get(content, str(content)) for content in slots),
            reason=f"{seen.reason}; slots 1 and 2 hold {slots}" if slots else seen.reason,
        )

    def is_like(self, seen: Seen) -> bool:
        """One of the slots holds the RS-485 accessory [table A.2]."""
        return _are_slots([seen[code][0] for code in self.slot_rows])

    def alarms(self, profile: Profile, points: Mapping[str, Any]) -> list[Alarm]:
        """Bits 15 and 14 of S5.1.1 say that there is something, D1.1.1 and D2.1.1-D2.1.5 what [S5.1].

        Whether gaps or repetitions occur in the five places of the alarms is not stated: all are looked at.
        """
        found = []
        number, *numbers = (points.get(name) for name in profile.alarm_points)
        if points.get("fault") is not False and number:
            found.append(alarm(profile, alarm_code("f", number), "fault"))
        elif points.get("fault"):
            found.append(unnumbered(profile, "fault"))
        known = dict.fromkeys(each for each in numbers if each)
        if points.get("alarm") is not False and known:
            found += [alarm(profile, alarm_code("a", each), "alarm") for each in known]
        elif points.get("alarm"):
            found.append(unnumbered(profile, "alarm"))
        return found

    def start_findings(self, settings: Settings) -> Iterator[Remark]:
        """Menu C3 [table A.2, C8.2.5.2]; C8.2.5.3 = 0.0 s is not explained (C8.2.5)."""
        codes = ("C3.1", "C3.2", "C3.3")
        yield from unread(settings, codes, Topic.START)
        own, slot = _source(settings.variant), settings.variant.slot
        if own is None or slot is None:
            what = "no command is sent while it is not known which slot holds the RS-485 accessory"
            yield start(Weight.ERROR, f"{what} (see S3.5.1 and S3.5.2, or configure `slot`)")
            return
        own_modes = (7 + 2 * slot, 8 + 2 * slot)  # Slot n LOC, Slot n REM
        yield from sources(settings, codes, own=own, name=f"Slot {slot}", own_modes=own_modes)
        if settings.number("C8.2.5.1") and settings.number("C8.2.5.3") == 0:
            what = "the manual does not say what a timeout of 0.0 s does"
            yield Remark(Topic.WATCHDOG, Weight.WARNING, f"{what}: {settings.shown('C8.2.5.1')}")

    def watchdogs(self, settings: Settings) -> tuple[Watchdog, ...]:
        """F128 or A128 after C8.2.5.3, counted from the first valid request on [C8.2.5]."""
        mode, tenths = settings.number("C8.2.5.1"), settings.number("C8.2.5.3")
        if mode not in (_FAULT, _ALARM) or not tenths:
            return ()
        action, own = settings.number("C8.2.5.2"), _source(settings.variant)
        chosen = (settings.number(code) for code in self.source_rows)
        if mode == _FAULT:
            does, is_felt = "trips with fault F128: the motor is disabled until a reset", True
        elif action not in _ALARM_ACTIONS:
            does, is_felt = "raises alarm A128 and does nothing else", False
        elif own is not None and not is_one_of((own,), *chosen):  # its slot is no source [C8.2.5.2]
            does = "raises alarm A128; its action has no effect, since C3.2 and C3.3 name other sources"
            is_felt = False
        else:
            does, is_felt = _ALARM_ACTIONS[action], True
        return (Watchdog("C8.2.5.3", tenths / 10, does, is_felt),)


def _rated_current_a(profile: Profile, size: int, current: int) -> float | None:
    """Return what C9.1.1 says; None where the size of S3.3.1 does not have it [table A.2]."""
    set_a = profile.enums["C9.1.1"].get(current, "").removesuffix(" A")
    low_a, _, high_a = profile.enums["S3.3.1"].get(size, "").removesuffix(" A").partition(" to ")
    return float(set_a) if set_a and low_a and float(low_a) <= float(set_a) <= float(high_a) else None


def _are_slots(contents: Sequence[int]) -> bool:
    """Return whether these can be the contents of an SSW900's slots; it answers by its RS-485 accessory."""
    return all(content in _SLOT_CONTENTS for content in contents) and _RS485 in contents


def _slot(slots: tuple[int, ...]) -> Literal[1, 2] | None:
    """Return the slot of the RS-485 accessory; None when both or none says so [3]."""
    if slots.count(_RS485) != 1:
        return None
    return 1 if slots[0] == _RS485 else 2


def _source(variant: Variant) -> int | None:
    """Return the number of this accessory's slot in C3.2 and C3.3; None while the slot is unknown."""
    return None if variant.slot is None else 3 + variant.slot


DEVICE = Ssw900Device()
