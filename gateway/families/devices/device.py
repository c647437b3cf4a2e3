"""The protocol that a family implements: what its profile's data cannot say, and nothing else.

A profile (`profiles/<family>/`) says what is read, written, demanded, read back and protected. A device
(`devices/<family>.py`) says how the family proves who it is, what its settings mean for a remote start, which
watchdogs are on, which alarms are active, and which procedures are more than a row of writes. Everything
here is pure; only rows that the profile names can be written.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from gateway.families.devices.findings import Finding, Settings, Watchdog
from gateway.families.profile.decode import alarm_code
from gateway.families.profile.procedure import Preparation, Procedure, Seen, refused
from gateway.families.profile.schema import Alarm, Profile, Variant
from gateway.modbus.device_id import ReadDeviceIdentification
from gateway.modbus.pdu import Request


@dataclass(frozen=True, slots=True)
class Question:
    """One request of an identification; the answer is handed to `identify` under its tag."""

    tag: str  # fc43, model_register, slots, firmware, model, name
    request: Request


@dataclass(frozen=True, slots=True)
class Identity:
    """What a unit said about itself; None is unknown. `reason` says why the family is, or is not, known."""

    family_seen: str | None = None
    model: str | None = None
    firmware: str | None = None
    serial: str | None = None
    rated_current_a: float | None = None
    rating: str | None = None  # SSW900: the range of currents of its size (S3.3.1)
    slot: Literal[1, 2] | None = None  # SSW900: where the RS-485 accessory sits
    accessories: tuple[str, ...] = ()  # SSW900: the kinds in slots 1 and 2
    hardware: str | None = None  # SST: its version
    reason: str = ""
    lacks: str = ""  # what every device of the configured family has and this one has not; empty: nothing


class Device:
    """A family; its methods here are those of one without habits of its own."""

    # How object 1 of FC43 names the family (None: it has no FC43), and whether with the rated current.
    product: re.Pattern[str] | None = None
    is_current_named = True
    slot_rows: tuple[str, ...] = ()  # what slots 1 and 2 hold

    # The rows that `start_findings` and `watchdogs` look at.
    start_rows: tuple[str, ...] = ()
    source_rows: tuple[str, ...] = ()  # on these hangs what a watchdog can do
    watchdog_rows: tuple[str, ...] = ()  # whether one is on, and after how long it acts
    watchdog_action = ""  # the one of these that only says what it does

    def questions(self, profile: Profile) -> tuple[Question, ...]:
        """Return what to ask a unit that is configured as this family; any may stay without answer."""
        return (Question("fc43", ReadDeviceIdentification(read_code=1, object_id=0)),)

    def identity(self, profile: Profile, seen: Identity, answers: Mapping[str, Any]) -> Identity:
        """Return who the unit is, out of what FC43 made known of it and the other answers by their tags."""
        return seen

    def alarms(self, profile: Profile, points: Mapping[str, Any]) -> list[Alarm]:
        """Return the faults and alarms that are active, faults first: `fault`, its number, `alarm`.

        The number may be that of the last fault, active or not (ssw07 P014): it counts while there is one.
        """
        found = []
        if points.get("fault"):
            number = points.get("fault_code")
            code = alarm_code("e", number) if number else ""
            found.append(alarm(profile, code, "fault", f"Fault {code.upper()}") if code else fault(profile))
        if points.get("alarm"):
            found.append(some_alarm(profile))
        return found

    def start_findings(self, settings: Settings) -> Iterable[Finding]:
        """Return what the settings mean for a start from afar."""
        return ()

    def watchdogs(self, settings: Settings) -> Iterable[Watchdog]:
        """Return the supervisions of the communication that are on."""
        return ()

    def prepare_configure(self, profile: Profile, variant: Variant, args: Mapping[str, Any]) -> Preparation:
        """Return what the verb `configure` reads and demands first; `set` too, of rows `is_configuration`."""
        raise refused("unknown_verb", f"{profile.title} has no procedure of its own")

    def build_configure(
        self, profile: Profile, variant: Variant, args: Mapping[str, Any], *, seen: Seen
    ) -> Procedure:
        """Return what it writes: a procedure, not the writes of a profile's entry."""
        raise refused("unknown_verb", f"{profile.title} has no procedure of its own")


def fault(profile: Profile) -> Alarm:
    """Return a fault without a number."""
    return alarm(profile, "fault", "fault", "Fault, its number is not known")


def some_alarm(profile: Profile) -> Alarm:
    """Return an alarm without a number."""
    return alarm(profile, "alarm", "alarm", "Alarm, its number is not known")


def alarm(profile: Profile, code: str, severity: str, text: str) -> Alarm:
    """Return the profile's alarm of this code, else one with this text."""
    named = next((each for each in profile.alarms if each.code == code), None)
    return named or Alarm.model_validate({"code": code, "severity": severity, "text": text})
