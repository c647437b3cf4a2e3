"""The records of one starter with their time and number, and its `info` record."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from gateway.families.command.build import verbs
from gateway.families.devices.device import Identity
from gateway.families.profile.names import meaning_of, printed_name
from gateway.families.profile.schema import Profile, Variant, once_per_profile
from gateway.history.own_points import own_points
from gateway.records import (
    OWN_VERBS,
    AlarmRecord,
    AvailabilityRecord,
    EventRecord,
    InfoRecord,
    LockRecord,
    Quality,
    Record,
    RecordWriter,
    Severity,
    StateRecord,
    ValueRecord,
)
from gateway.starters.setup import StarterSetup
from gateway.starters.telemetry.decoding import type_of, unit_of
from gateway.starters.telemetry.snapshot import Reading, Value
from gateway.starters.telemetry.transitions import AlarmStatus, Change

LockOf = Callable[[str], LockRecord | None]


class Emitter:
    """Puts the records of one starter into the sink."""

    def __init__(
        self,
        starter: str,
        records: RecordWriter,
        *,
        lock_of: LockOf = lambda _: None,
    ) -> None:
        self.starter = starter
        self._lock_of = lock_of
        self._sink = records.sink
        self._clock = records.clock
        self._sequence = records.sequence

    def put(self, *records: Record) -> None:
        """Publish records, in order."""
        for record in records:
            self._sink.put(record)

    def event(self, code: str, severity: Severity, text: str, data: Mapping[str, Any] | None = None) -> None:
        """Publish something that happened now."""
        self.put(self.change(Change(code, severity, text, data or {})))

    def availability(self, state: str, *, reason: str | None) -> None:
        """Publish that the starter is online, offline or disabled from now on."""
        self.put(AvailabilityRecord(self.starter, state, self._clock.utc_s(), reason))

    # Records that are made where something is decoded, and published after that.

    def value(self, point: str, reading: Reading) -> ValueRecord:
        """Return one point's reading."""
        return ValueRecord(
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

    def state(
        self,
        state: str,
        *,
        quality: Quality,
        time_s: float | None,
        flags: Mapping[str, Value],
        reason: str = "",
    ) -> StateRecord:
        """Return the state with its boolean points, and the starter's lock."""
        known = {name: value if isinstance(value, bool) else None for name, value in flags.items()}
        seq, lock = self._sequence.take(), self._lock_of(self.starter)
        return StateRecord(self.starter, state, quality, time_s, seq, known, lock, reason)

    def alarm(self, standing: AlarmStatus) -> AlarmRecord:
        """Return one fault or alarm as it stands."""
        return AlarmRecord(
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

    def change(
        self, change: Change, *, time_s: float | None = None, more: Mapping[str, Any] | None = None
    ) -> EventRecord:
        """Return something that happened, now or at `time_s`, with what else is known of it."""
        return EventRecord(
            starter=self.starter,
            code=change.code,
            severity=change.severity,
            text=change.text,
            time_s=self._clock.utc_s() if time_s is None else time_s,
            seq=self._sequence.take(),
            data={**change.data, **(more or {})},
        )


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
        "name": printed_name(profile, name),
        "meaning": meaning_of(profile, name),
        "unit": unit_of(profile, name),
        "type": kind,
        "enum": {str(value): label for value, label in labels.items()} or None,
        "deadband": point.deadband,
    }


@once_per_profile
def _descriptions(profile: Profile) -> Mapping[str, Mapping[str, Any]]:
    own = {point.name: point.to_dict() for point in own_points(profile)}
    return {name: _describe(profile, name) for name in profile.points} | own
