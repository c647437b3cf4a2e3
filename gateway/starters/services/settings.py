"""The settings of one starter, read in the background: how ready it is, and what was changed at its keypad.

1. Once the starter is identified, and after each command that sets one of them, the rows are read that decide
   about a remote start and its watchdogs. They are the event `readiness` when they say something else.
2. All settings are read round and round, a block at a time. One that says something else than before, and
   that no own command has set, is the event `parameter_changed` before the next block is read; the first
   reading of all is none.
3. A row that is refused in `REFUSALS` laps is left out for the rest of the hour, unless it is a watchdog's.
"""

from __future__ import annotations

import asyncio
import itertools
import logging
from collections import Counter, deque
from collections.abc import Iterable, Mapping
from functools import partial
from math import inf
from typing import Any

from gateway.contract import CommandError, EventCode, Phase, Severity, phrase
from gateway.errors import PortLostError
from gateway.families import (
    Parameter,
    Profile,
    Read,
    Weight,
    diagnosis,
    once_per_profile,
    parameters,
    reading,
)
from gateway.line import Priority
from gateway.starters.bulk_read import BulkReading, read_in_bulk
from gateway.starters.identity import IdentityStatus
from gateway.starters.parameters.model import ParameterEntry, entries_of
from gateway.starters.starter import StarterTelemetry
from gateway.system.rate_limits import ChangeDetector
from gateway.system.supervised import SupervisedTask

logger = logging.getLogger(__name__)

PAUSES_S = (0.0, 5.0, 30.0, 120.0)  # before each attempt to read what decides about a start
EVERY_S = 60.0  # one block of the laps; an SSW900's settings are some 20 blocks
FIRST_LAP_EVERY_S = 10.0  # until all of them are known: what is changed before cannot be noticed
REFUSALS, HOUR_S = 3, 3600.0
LONGEST_BLOCK = 24  # registers: no request of an identification is shorter, so no stop waits longer
WATCHDOG_TOPIC = "watchdog"  # of what keeps a starter from being read whole
VERBS = ("set", "configure")  # that set settings

_MAYBE_SET = (Phase.CONFIRMED, Phase.UNCONFIRMED, Phase.FAILED)  # of several rows the last may have failed
IDENTIFIED = (IdentityStatus.MATCHING, IdentityStatus.CHANGED, IdentityStatus.OTHER_SLOT)
_SEVERITIES = {Weight.NOTE: Severity.INFO, Weight.WARNING: Severity.WARNING, Weight.ERROR: Severity.ERROR}

Words = tuple[int, ...]


class SettingsWatch:
    """Reads one starter while it answers; everything on the app's loop."""

    def __init__(self, starter: StarterTelemetry, recalled: Mapping[str, Words], *, every_s: float) -> None:
        """Begin with rows as an earlier run has read them."""
        self._starter = starter
        self._every_s = every_s
        self._watched = watched_codes(starter.profile)
        self._known = {code: words for code, words in recalled.items() if code in self._watched}
        self._changed: dict[str, Words] = {}  # from what, until that is published
        self._refusals: Counter[str] = Counter()  # by row, in laps since the hour began
        self._published = ChangeDetector()  # what the last event `readiness` was made of
        self._readiness = SupervisedTask(f"readiness {starter.setup.name}")
        self._patrol = SupervisedTask(f"keypad {starter.setup.name}")
        self._is_walking = False

    def begin(self) -> None:
        """Look at the readiness, and go on with the laps; the starter is identified."""
        self._readiness.begin(self._look_until_read)
        if not self._is_walking:
            self._is_walking = True
            self._patrol.begin(self._walk)

    def note_end(self, verb: str, args: Mapping[str, Any], phase: str) -> None:
        """Take a row that an own command has set for known, and look at the readiness if it hangs on that.

        Where it is open whether it was written the next reading counts as the first.
        """
        profile, codes = self._starter.profile, set[str]()
        for code, value in _rows_set(verb, args).items():
            try:
                row = parameters.find(profile, code)
                words = parameters.to_words(profile, row, value, variant=self._starter.variant)
            except CommandError:  # it was refused, too
                continue
            codes.add(row.code)
            if phase in _MAYBE_SET:
                self._changed.pop(row.code, None)
                self._known.pop(row.code, None)
            if phase == Phase.CONFIRMED and row.code in self._watched:
                self._known[row.code] = words
        if not codes.isdisjoint(diagnosis.readiness_codes(profile)):
            self._readiness.begin(self._look_until_read)

    async def close(self) -> None:
        """Read nothing more."""
        await self._readiness.close()
        await self._patrol.close()

    async def _look_until_read(self) -> None:
        """Read what decides about a start, ever less often until the rows of the watchdog are known."""
        starter = self._starter
        for pause_s in itertools.chain(PAUSES_S, itertools.repeat(PAUSES_S[-1])):
            await asyncio.sleep(pause_s)
            if not starter.is_answering or starter.identity_standing not in IDENTIFIED:
                return  # its next identification begins this again
            codes, began_s = diagnosis.readiness_codes(starter.profile), asyncio.get_running_loop().time()
            try:
                found = await self._read(reading.bulk_reads(starter.profile, codes))
            except (CommandError, PortLostError) as error:
                logger.info("starter=%s readiness is not known: %s", starter.setup.name, error)
                continue
            # On some of them hangs what is permitted, and no poll reads those.
            starter.snapshot.keep_rows(found.rows, at_s=began_s)
            self._note_reading(found.rows)
            self._publish_readiness(found.rows, await starter.gap_s())
            trouble = _watchdog_trouble(starter.profile, found.refused)
            starter.set_trouble(WATCHDOG_TOPIC, trouble)
            if not trouble:
                return

    async def _walk(self) -> None:
        hour_began_s, every_s = -inf, min(FIRST_LAP_EVERY_S, self._every_s)
        now_s = asyncio.get_running_loop().time
        watched = self._watched
        vital = diagnosis.watchdog_codes(self._starter.profile)
        while watched:
            if now_s() - hour_began_s >= HOUR_S:
                hour_began_s = now_s()
                self._refusals.clear()
            codes = [code for code in watched if self._refusals[code] < REFUSALS or code in vital]
            reads = deque(_planned(self._starter.profile, codes))
            if not reads:  # each row was refused
                await asyncio.sleep(HOUR_S)
            while reads:
                await asyncio.sleep(every_s)
                while self._changed:  # a command that has set one of them has ended by now
                    self._publish_change(*self._changed.popitem())
                if not self._may_read():
                    continue
                try:
                    found = await self._read([reads.popleft()])
                except (CommandError, PortLostError):  # the polls publish that it is silent
                    continue
                self._refusals.update(found.refused.keys())
                if self._note_reading(found.rows):
                    self._readiness.begin(self._look_until_read)
            every_s = self._every_s

    def _may_read(self) -> bool:
        starter = self._starter
        return starter.is_answering and starter.identity_standing is IdentityStatus.MATCHING

    async def _read(self, reads: Iterable[Read]) -> BulkReading:
        """Read rows for which everything else goes first; CommandError, PortLostError."""
        ask = partial(self._starter.ask, lane=Priority.PATROL)
        found = await read_in_bulk(ask, self._starter.profile, reads, tries=1)
        self._starter.note_settings(found.rows)
        return found

    def _note_reading(self, rows: Mapping[str, Words]) -> bool:
        """Take settings that were just read; return whether one has changed."""
        changed = [code for code in rows.keys() & self._known.keys() if self._known[code] != rows[code]]
        for code in changed:
            self._changed.setdefault(code, self._known[code])
        self._known |= {code: words for code, words in rows.items() if code in self._watched}
        return bool(changed)

    def _publish_change(self, code: str, before: Words) -> None:
        starter = self._starter
        if before == self._known[code]:
            return  # it was changed back
        old, new = (
            entries_of(starter.profile, starter.variant, {code: words})[code]
            for words in (before, self._known[code])
        )
        starter.emitter.event(
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
            slot_trouble=diagnosis.slot_trouble(starter.profile, setup.variant, starter.identity),
        )
        said = (tuple(sorted(rows.items())), tuple(finding.weight for finding in findings))
        if not findings or not self._published.is_new(said):
            return
        problems = "; ".join(each.text for each in findings if each.weight is not Weight.NOTE)
        starter.emitter.event(
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


def _planned(profile: Profile, codes: Iterable[str]) -> tuple[Read, ...]:
    return reading.bulk_reads(profile, codes, longest=min(LONGEST_BLOCK, profile.limits.read_registers // 2))


def _rows_set(verb: str, args: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a command sets, by code."""
    if verb != "set":
        return dict(args)
    several = [each for each in args.values() if isinstance(each, Mapping)]
    wanted = {str(code): value for each in several for code, value in each.items()}
    return wanted or {str(args.get("parameter")): args.get("value")}


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
