"""One starter's voice: turns what is known into records with their time and number.

What a starter is, told once and whenever it changes: its points, its commands, who it says it is.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gateway.families.command.build import verbs
from gateway.families.profile.identify import Identity
from gateway.families.profile.schema import Profile, Variant
from gateway.records import (
    OWN_VERBS,
    AlarmRecord,
    AvailabilityRecord,
    EventRecord,
    InfoRecord,
    Quality,
    SequenceNumbers,
    Severity,
    Sink,
    StateRecord,
    ValueRecord,
)
from gateway.starters.setup import StarterSetup
from gateway.starters.telemetry.decoding import type_of, unit_of
from gateway.starters.telemetry.snapshot import Reading, Value, as_flag
from gateway.starters.telemetry.transitions import AlarmStatus, Change
from gateway.system.clock import Clock


class Emitter:
    """Puts the records of one starter into the sink."""

    def __init__(self, starter: str, *, sink: Sink, clock: Clock, sequence: SequenceNumbers) -> None:
        self.starter = starter
        self.sink = sink
        self._clock = clock
        self._sequence = sequence

    def value(self, point: str, reading: Reading) -> None:
        """Publish one point's reading."""
        self.sink.put(
            ValueRecord(
                starter=self.starter,
                point=point,
                value=reading.value,
                unit=reading.unit,
                quality=reading.quality,
                time_s=reading.time_s,
                seq=self._sequence.take(),
                label=reading.label,
                reason=reading.reason,
            )
        )

    def state(
        self,
        state: str,
        *,
        quality: Quality,
        time_s: float | None,
        flags: Mapping[str, Value],
        reason: str = "",
    ) -> None:
        """Publish the state with its boolean points."""
        seq = self._sequence.take()
        self.sink.put(
            StateRecord(
                self.starter,
                state,
                quality,
                time_s,
                seq,
                {name: as_flag(value) for name, value in flags.items()},
                reason=reason,
            )
        )

    def availability(self, state: str, *, reason: str | None) -> None:
        """Publish that the starter is online, offline or disabled from now on."""
        self.sink.put(AvailabilityRecord(self.starter, state, self._clock.utc_s(), reason))

    def alarm(self, standing: AlarmStatus) -> None:
        """Publish one fault or alarm as it stands."""
        self.sink.put(
            AlarmRecord(
                starter=self.starter,
                code=standing.alarm.code,
                is_active=standing.is_active,
                severity=standing.alarm.severity,
                text=standing.alarm.text,
                time_s=standing.raised_s,
                cleared_s=standing.cleared_s,
                count=standing.count,
                seq=self._sequence.take(),
            )
        )

    def change(
        self, change: Change, *, time_s: float | None = None, more: Mapping[str, Any] | None = None
    ) -> None:
        """Publish something that happened, now or at `time_s`, with what else is known of it."""
        self.sink.put(
            EventRecord(
                starter=self.starter,
                code=change.code,
                severity=change.severity,
                text=change.text,
                time_s=self._clock.utc_s() if time_s is None else time_s,
                seq=self._sequence.take(),
                data={**change.data, **(more or {})},
            )
        )

    def event(self, code: str, severity: Severity, text: str, data: Mapping[str, Any] | None = None) -> None:
        """Publish something that happened now."""
        self.change(Change(code, severity, text, data or {}))


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
