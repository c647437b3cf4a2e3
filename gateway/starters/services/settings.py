"""The settings of one starter, read in the background: how ready it is, and what was changed at its keypad.

1. Once the starter is identified, and after each write to one of them, the rows are read that decide about a
   remote start and its watchdogs. They are the event `readiness` when they say something else.
2. All settings are read round and round, a block at a time; after a silence the round goes on. A setting
   that says something else than before is the event `parameter_changed`; the first reading of all is none,
   nor is the first after an own write.
3. A row that is refused is left out for an hour, unless it is a watchdog's.
"""

from __future__ import annotations

import asyncio
import itertools
from collections.abc import Mapping
from functools import partial
from math import inf
from typing import Any

from gateway.contract import EventCode, Severity, phrase
from gateway.families import (
    Parameter,
    Profile,
    Weight,
    diagnosis,
    once_per_profile,
    reading,
)
from gateway.modbus import Request
from gateway.starters.bulk_read import short_reads
from gateway.starters.parameters.model import ParameterEntry, entries_of
from gateway.starters.starter import StarterService, StarterTelemetry
from gateway.system.rate_limits import ChangeDetector
from gateway.system.supervised import SupervisedTask

PAUSES_S = (5.0, 30.0, 120.0)  # before each further attempt to read what decides about a start
AFTER_WRITE_S = 1.0  # a command may write more
EVERY_S = 60.0  # one block; an SSW900's settings are some 20 blocks
FIRST_ROUND_EVERY_S = 10.0  # at first, and after each silence: changes are to be noticed soon
REFUSED_FOR_S = 3600.0
WATCHDOG_TOPIC = "watchdog"  # of what keeps a starter from being read whole

_SEVERITIES = {Weight.NOTE: Severity.INFO, Weight.WARNING: Severity.WARNING, Weight.ERROR: Severity.ERROR}

Words = tuple[int, ...]


class SettingsWatch(StarterService):
    """Reads one starter while it answers, from the rows on that an earlier run has read."""

    def __init__(self, starter: StarterTelemetry) -> None:
        self._starter = starter
        self._watched = watched_codes(starter.profile)
        recalled = starter.watchdogs.rows(starter.setup.name)
        self._known = {code: words for code, words in recalled.items() if code in self._watched}
        self._refused_s: dict[str, float] = {}  # by row: when it was refused
        self._next = 0  # the block of the settings that is read next
        self._published = ChangeDetector()  # what the last event `readiness` was made of
        self._readiness = SupervisedTask(f"readiness {starter.setup.name}")
        self._patrol = SupervisedTask(f"keypad {starter.setup.name}")

    def begin(self) -> None:
        """Look at the readiness, and go on with the round of all settings."""
        self._readiness.begin(self._look_until_read)
        if self._watched:
            self._patrol.begin(self._walk)

    def note_written(self, request: Request) -> None:
        """Forget the rows that the gateway has written; look at the readiness if it hangs on them."""
        profile = self._starter.profile
        written = diagnosis.written_rows(profile, [request]).keys()
        for code in written:
            self._known.pop(code, None)
        if not written.isdisjoint(diagnosis.readiness_codes(profile)):
            self._readiness.begin(partial(self._look_until_read, after_s=AFTER_WRITE_S))

    async def close(self) -> None:
        """Read nothing more."""
        await self._readiness.close()
        await self._patrol.close()

    async def _look_until_read(self, *, after_s: float = 0.0) -> None:
        """Read what decides about a start, ever less often until the rows of the watchdog are known."""
        starter = self._starter
        for pause_s in itertools.chain((after_s, *PAUSES_S), itertools.repeat(PAUSES_S[-1])):
            await asyncio.sleep(pause_s)
            if not starter.standing.is_family:
                return  # its next identification begins this again
            codes, began_s = diagnosis.readiness_codes(starter.profile), asyncio.get_running_loop().time()
            found = await starter.read_rows(codes)
            if found is None:
                continue
            # On some of them hangs what is permitted, and no poll reads those.
            starter.snapshot.keep_rows(found.rows, at_s=began_s)
            self._note_reading(found.rows)
            self._publish_readiness(found.rows, await starter.watchdogs.gap_s(starter.setup))
            trouble = _watchdog_trouble(starter.profile, found.refused)
            starter.availability.set_trouble(WATCHDOG_TOPIC, trouble)
            if not trouble:
                return

    async def _walk(self) -> None:
        """Read the settings block by block; the first round goes faster."""
        starter, now_s = self._starter, asyncio.get_running_loop().time
        blocks = short_reads(starter.profile, tuple(self._watched))
        vital = diagnosis.watchdog_codes(starter.profile)
        for count in itertools.count():
            await asyncio.sleep(FIRST_ROUND_EVERY_S if count < len(blocks) else EVERY_S)
            if not starter.is_identified:
                return  # its next identification goes on from here
            block, since_s = blocks[self._next], now_s() - REFUSED_FOR_S
            self._next = (self._next + 1) % len(blocks)
            codes = [c for c in block.codes if c in vital or self._refused_s.get(c, -inf) <= since_s]
            found = await starter.read_rows(codes)
            if found is None:
                continue
            self._refused_s |= dict.fromkeys(found.refused, now_s())
            if self._note_reading(found.rows):
                self._readiness.begin(self._look_until_read)

    def _note_reading(self, rows: Mapping[str, Words]) -> bool:
        """Take settings that were just read; publish those that have changed, and return whether one has."""
        before = {code: self._known[code] for code in rows.keys() & self._known.keys()}
        changed = [code for code, words in before.items() if rows[code] != words]
        self._known |= {code: words for code, words in rows.items() if code in self._watched}
        for code in changed:
            self._publish_change(code, before[code], rows[code])
        return bool(changed)

    def _publish_change(self, code: str, before: Words, after: Words) -> None:
        starter = self._starter
        old, new = (
            entries_of(starter.profile, starter.variant, {code: words})[code] for words in (before, after)
        )
        starter.event(
            EventCode.PARAMETER_CHANGED,
            parameter=code,
            name=old.name,
            before=_as_data(old),
            after=_as_data(new),
            old=old.shown,
            new=new.shown,
        )

    def _publish_readiness(self, rows: Mapping[str, Words], gap_s: float | None) -> None:
        starter, setup = self._starter, self._starter.setup
        findings = diagnosis.readiness(
            starter.profile,
            starter.variant,
            rows,
            gap_s=gap_s,
            watchdog_s=setup.watchdog_s,
            slot_trouble=diagnosis.slot_trouble(starter.profile, setup.variant, starter.standing.identity),
        )
        said = (tuple(sorted(rows.items())), tuple(finding.weight for finding in findings))
        if not findings or not self._published.is_new(said):
            return
        problems = "; ".join(each.text for each in findings if each.weight is not Weight.NOTE)
        starter.event(
            EventCode.READINESS,
            severity=_SEVERITIES[findings[0].weight],  # errors come first
            would_refuse_start=diagnosis.refuses_start(findings),
            findings=[
                {"topic": each.topic.value, "weight": each.weight.value, "text": each.text}
                for each in findings
            ],
            watchdogs=[
                {"parameter": each.code, "after_s": each.after_s, "does": each.does}
                for each in diagnosis.watchdogs(starter.profile, starter.variant, rows)
            ],
            problems=problems or phrase(EventCode.READINESS, "ready"),
        )


@once_per_profile
def watched_codes(profile: Profile) -> Mapping[str, Parameter]:
    """Return the settings of a family that change only when somebody sets them, by code."""
    return {c: row for c, row in profile.parameters.items() if reading.is_set_by_people(profile, row)}


def _watchdog_trouble(profile: Profile, refused: Mapping[str, str]) -> str:
    """Return in words which rows are refused without which the watchdog is not known; empty for none."""
    missing = [
        phrase(EventCode.DEGRADED, "row_refused", code=code, why=why)
        for code, why in refused.items()
        if code in diagnosis.watchdog_codes(profile) and profile.parameters[code].is_sure
    ]
    return phrase(EventCode.DEGRADED, "watchdog_unknown", rows="; ".join(missing)) if missing else ""


def _as_data(entry: ParameterEntry) -> dict[str, Any]:
    return {"value": entry.value, "label": entry.label, "unit": entry.unit, "raw": list(entry.raw or ())}
