"""The protocol that a family implements: what its profile's data cannot say, and nothing else.

A profile (`profiles/<family>/`) says what is read, written, demanded, read back and protected. A device
(`devices/<family>.py`) says how the family proves who it is, what its settings mean for a remote start, which
watchdogs are on, which alarms are active, and which procedures are more than a row of writes. Everything
here is pure; only rows that the profile names can be written.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

from gateway.contract import CommandError, ResultCode
from gateway.families.devices.findings import Remark, Settings, Watchdog
from gateway.families.profile.decode import NOT_IN_MANUAL, alarm_code
from gateway.families.profile.procedure import Preparation, Procedure, Seen
from gateway.families.profile.rows import Alarm
from gateway.families.profile.schema import Profile, Variant
from gateway.modbus import ReadDeviceIdentification, Request


@dataclass(frozen=True, slots=True)
class Question:
    """One request of an identification; the answer is handed to `identify` under its tag."""

    tag: str  # fc43, register, slots, firmware, model, name
    request: Request
    is_always_there: bool = False  # the registers: a device without them is of another family
    is_for_doubt: bool = False  # only where FC43 was not answered at once


@dataclass(frozen=True, slots=True)
class Identity:
    """A unit's answers about itself; None is unknown. `reason` says why the family is, or is not, known."""

    family_seen: str | None = None
    model: str | None = None
    firmware: str | None = None
    serial: str | None = None
    rated_current_a: float | None = None
    rating: str | None = None  # SSW900: the range of currents of its size (S3.3.1), which no setting changes
    slot: Literal[1, 2] | None = None  # SSW900: where the RS-485 accessory sits
    accessories: tuple[str, ...] = ()  # SSW900: the kinds in slots 1 and 2
    hardware: str | None = None  # SST: its version
    reason: str = ""
    lacks: str = ""  # what every device of the configured family has and this one has not; empty: nothing


class Device:
    """A family; its methods here are those of a family without special rules."""

    # How object 1 of FC43 names the family (None: it has no FC43), and whether with the rated current.
    product: re.Pattern[str] | None = None
    names: re.Pattern[str] | None = None  # how its models are named where that is not `product`
    is_current_named = True
    slot_rows: tuple[str, ...] = ()  # what slots 1 and 2 hold
    distinctive_rows: tuple[str, ...] = ()  # they show another family where a status might look plausible

    # The rows that `start_findings` and `watchdogs` look at.
    start_rows: tuple[str, ...] = ()
    source_rows: tuple[str, ...] = ()  # on these hangs what a watchdog can do
    watchdog_rows: tuple[str, ...] = ()  # whether one is on, and after how long it acts
    watchdog_action = ""  # the one of these that only says what it does

    # Telegrams received and sent, telegrams received with a wrong CRC, bytes received with other errors, as
    # the starter itself counts them; cyclic.
    counter_rows: tuple[str, ...] = ()

    def questions(self, profile: Profile) -> tuple[Question, ...]:
        """Return what to ask a unit that is configured as this family; any may stay without answer.

        FC43 comes last: a device that does not know it may be silent for a while after it.
        """
        return (Question("fc43", ReadDeviceIdentification(read_code=1, object_id=0)),)

    def identity(self, profile: Profile, seen: Identity, answers: Mapping[str, Any]) -> Identity:
        """Return who the unit is, out of what FC43 made known of it and the other answers by their tags."""
        return seen

    def is_like(self, seen: Seen) -> bool:
        """Return whether the distinctive rows, all of which were seen, hold what this family has there."""
        return True

    def alarms(self, profile: Profile, points: Mapping[str, Any]) -> list[Alarm]:
        """Return the active faults and alarms, faults first, each once: `fault`, its number, `alarm`.

        The number may be that of the last fault, active or not (ssw07 P014): it counts while there is one.
        """
        found = []
        if points.get("fault"):
            number = points.get("fault_code")
            code = alarm_code("e", number) if number else ""
            found.append(alarm(profile, code, "fault") if code else unnumbered(profile, "fault"))
        if points.get("alarm"):
            found.append(unnumbered(profile, "alarm"))
        return found

    def start_findings(self, settings: Settings) -> Iterable[Remark]:
        """Return what the settings mean for a remote start."""
        return ()

    def watchdogs(self, settings: Settings) -> Iterable[Watchdog]:
        """Return the supervisions of the communication that are on."""
        return ()

    def prepare_configure(self, profile: Profile, variant: Variant, args: Mapping[str, Any]) -> Preparation:
        """Return what the verb `configure` reads and demands first; `set` too, of rows `is_configuration`."""
        raise CommandError(ResultCode.UNKNOWN_VERB, "procedure", title=profile.title)

    def build_configure(
        self, profile: Profile, variant: Variant, args: Mapping[str, Any], *, seen: Seen
    ) -> Procedure:
        """Return what it writes: a procedure, not the writes of a profile's entry."""
        raise CommandError(ResultCode.UNKNOWN_VERB, "procedure", title=profile.title)


def denied_by_name(seen: Identity) -> Identity:
    """Return an identity that FC43 names as a product of no known family as one that contradicts any."""
    is_named_otherwise = seen.family_seen is None and seen.model is not None
    return replace(seen, lacks=seen.lacks or seen.reason) if is_named_otherwise else seen


def alarm(profile: Profile, code: str, severity: Literal["fault", "alarm"]) -> Alarm:
    """Return the profile's fault or alarm of this code, else one that says that the manual has none."""
    named = next((each for each in profile.alarms if each.code == code), None)
    text = f"{severity.capitalize()} {code.upper()} {NOT_IN_MANUAL}"
    return named or Alarm(code=code, severity=severity, text=text)


def unnumbered(profile: Profile, severity: Literal["fault", "alarm"]) -> Alarm:
    """Return a fault or an alarm without a number."""
    why = "is not known" if profile.alarm_points else "can be read at the starter only"
    return Alarm(code=severity, severity=severity, text=f"{severity.capitalize()}, its number {why}")
