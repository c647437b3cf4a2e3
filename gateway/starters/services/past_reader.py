"""Reads what a starter itself says of its past: after a trip its faults, now and then its own counters.

All of it has the priority of the background, in short requests: no poll, stop or watchdog waits for it
longer than for one of these. What is refused is left out.
"""

from __future__ import annotations

import asyncio
import itertools
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Protocol

from gateway.contract import EventCode
from gateway.families import Profile, decode
from gateway.starters.parameters.model import ParameterEntry, entries_of
from gateway.starters.services.settings import SettingsWatch
from gateway.starters.starter import StarterService, StarterTelemetry
from gateway.starters.state import Happening, Happenings
from gateway.system.supervised import SupervisedTask

OWN_EVERY_S = 60.0  # the starter's own counters and thermal level
SETTINGS_EVERY = 60  # readings of the counters, one of the settings: an hour
AGAIN_S = 1.0  # before what was not answered is asked for again,
TRIES = 5  # that often after a trip


class PastListener(Protocol):
    """Receives what was read; the app's history is one."""

    def note_fault_data(
        self, starter: str, at_fault: Mapping[str, Mapping[str, Any]], history: Sequence[Mapping[str, Any]]
    ) -> None:
        """Record what was read after a trip; both are empty where nothing could be read."""

    def note_start_data(self, starter: str, rows: Mapping[str, Mapping[str, Any]]) -> None:
        """Record what the starter itself has stored of the start that has just ended; by code."""

    def note_own_rows(self, starter: str, rows: Mapping[str, float]) -> None:
        """Record numbers of rows that `Profile.history` names, by code, just read."""


class PastReader(StarterService):
    """Reads one starter."""

    def __init__(self, starter: StarterTelemetry, listener: PastListener) -> None:
        self._starter = starter
        self._listener = listener
        self._fault = SupervisedTask(f"fault data {starter.setup.name}")
        self._start = SupervisedTask(f"start data {starter.setup.name}")
        self._own = SupervisedTask(f"own counters {starter.setup.name}")

    def begin(self) -> None:
        """Read the starter's own counters from now on."""
        if own_codes(self._starter.profile):
            self._own.begin(self._read_own)

    def note_change(self, before: str, after: str, happenings: Happenings) -> None:
        """Read what the starter says of a trip, or has stored of a start that has reached its end."""
        if any(isinstance(each, Happening) and each.event.code == EventCode.FAULT for each in happenings):
            self._fault.begin(self._read_fault)
        if (before, after) == ("starting", "running") and self._starter.profile.history.at_start:
            self._start.begin(self._read_start)

    async def close(self) -> None:
        """Read nothing more."""
        await self._fault.close()
        await self._start.close()
        await self._own.close()

    async def _read_start(self) -> None:
        shown = await self._read_shown(self._starter.profile.history.at_start)
        self._listener.note_start_data(self._starter.setup.name, shown)

    async def _read_fault(self) -> None:
        rows = self._starter.profile.history
        shown = await self._read_shown((*rows.fault_history, *rows.at_fault))
        self._listener.note_fault_data(
            self._starter.setup.name,
            {code: shown[code] for code in rows.at_fault if code in shown},
            [{"code": code, **shown[code]} for code in rows.fault_history if code in shown],
        )

    async def _read_own(self) -> None:
        counters, settings = own_codes(self._starter.profile), _settings(self._starter.profile)
        for count in itertools.count():
            if not self._starter.is_answering:
                return  # its next identification begins this again
            found = await self._read(counters if count % SETTINGS_EVERY else (*counters, *settings))
            values = {code: entry.value for code, entry in found.items()}
            numbers = {code: float(each) for code, each in values.items() if isinstance(each, int | float)}
            self._listener.note_own_rows(self._starter.setup.name, numbers)
            await asyncio.sleep(OWN_EVERY_S)

    async def _read_shown(self, codes: Sequence[str]) -> dict[str, dict[str, Any]]:
        """Return these rows for a record, asked for some times; empty where nothing is answered."""
        for _ in range(TRIES):
            found = await self._read(codes)
            if found:
                return {code: _shown(self._starter.profile, code, entry) for code, entry in found.items()}
            await asyncio.sleep(AGAIN_S)
        return {}

    async def _read(self, codes: Iterable[str]) -> dict[str, ParameterEntry]:
        """Return these rows as far as they are given; none when the starter cannot be asked now."""
        starter = self._starter
        found = await starter.read_rows(codes) if starter.is_identified else None
        return {} if found is None else entries_of(starter.profile, starter.variant, found.rows)


def own_codes(profile: Profile) -> tuple[str, ...]:
    """Return the rows of a family that count or show its heat, and that no point is read from."""
    rows = profile.history
    polled = {point.code for point in profile.family_points.values()}
    return tuple(code for code in (rows.thermal, rows.hours, rows.energy) if code and code not in polled)


def _settings(profile: Profile) -> tuple[str, ...]:
    rows = profile.history
    return tuple(code for code in (rows.cooling, rows.after_stop, rows.between_starts) if code)


def _shown(profile: Profile, code: str, entry: ParameterEntry) -> dict[str, Any]:
    """Return a row as the record of a trip has it; a fault's number with the code of its alarm."""
    shown: dict[str, Any] = {"value": entry.value, "unit": entry.unit, "name": entry.name}
    if entry.label is not None:
        shown["label"] = entry.label
    if code in profile.alarm_rows and isinstance(entry.value, int) and entry.value:
        shown["alarm"] = decode.alarm_code(profile.alarm_rows[code], entry.value)
    return shown


def serve(starter: StarterTelemetry, *, past: PastListener) -> None:
    """Have a starter's settings watched, and what it says of its past read."""
    starter.services += (SettingsWatch(starter), PastReader(starter, past))
