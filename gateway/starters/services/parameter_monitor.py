"""Re-reads a starter's settings in the background and publishes changes that no command made."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from math import inf
from typing import Any

from gateway.contract import CommandError, Event, EventCode, event_of
from gateway.errors import PortLostError
from gateway.families import Profile, Read, Variant, diagnosis, once_per_profile, parameters, reading
from gateway.line import Priority
from gateway.starters.bulk_read import read_in_bulk
from gateway.starters.identity import IdentityStatus
from gateway.starters.parameters.model import ParameterEntry, entries_of
from gateway.starters.view import PolledStarter
from gateway.system.supervised import SupervisedTask


@once_per_profile
def watched_codes(profile: Profile) -> tuple[str, ...]:
    """Return the settings of a family that change only when somebody sets them."""
    return tuple(row.code for row in profile.parameters.values() if reading.is_set_by_people(profile, row))


class ParameterChanges:
    """Compares each reading of a setting with the one before it; the first one of all is no change."""

    def __init__(self, profile: Profile) -> None:
        self._profile = profile
        self._watched = watched_codes(profile)
        self._known: dict[str, tuple[int, ...]] = {}
        self._ours: dict[str, tuple[int, ...]] = {}  # what we last set, until it is read
        self._settled: set[str] = set()  # of these, what the command has ended for

    def note_command(self, variant: Variant, verb: str, args: Mapping[str, Any], *, is_over: bool) -> None:
        """Record that a `set` or `configure` of ours is under way; `is_over` once it has ended.

        What it wrote is ours up to the first reading after its end.
        """
        for code, value in rows_set(verb, args).items():
            try:
                row = parameters.find(self._profile, code)
                words = parameters.to_words(self._profile, row, value, variant=variant)
            except CommandError:  # it is refused then
                continue
            self._ours[row.code] = words
            if is_over:
                self._settled.add(row.code)
            else:
                self._settled.discard(row.code)

    def recall(self, rows: Mapping[str, tuple[int, ...]]) -> None:
        """Record rows as they were read in an earlier run, as far as nothing newer is known."""
        self._known = {code: words for code, words in rows.items() if code in self._watched} | self._known

    def note_reading(self, variant: Variant, rows: Mapping[str, tuple[int, ...]]) -> tuple[Event, ...]:
        """Record settings that were just read and return what somebody else has changed."""
        found = []
        for code, words in rows.items():
            if code not in self._watched:
                continue
            before = self._known.get(code)
            self._known[code] = words
            ours = self._ours.get(code)
            if code in self._settled:
                self._settled.discard(code)
                del self._ours[code]
            if before not in (None, words) and ours != words:
                found.append(self._changed(variant, code, before or (), words))
        return tuple(found)

    def _changed(self, variant: Variant, code: str, before: tuple[int, ...], after: tuple[int, ...]) -> Event:
        old = entries_of(self._profile, variant, {code: before})[code]
        new = entries_of(self._profile, variant, {code: after})[code]
        return event_of(
            EventCode.PARAMETER_CHANGED,
            parameter=code,
            name=old.name,
            before=_as_data(old),
            after=_as_data(new),
            old=old.shown,
            new=new.shown,
        )


def rows_set(verb: str, args: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a command sets, by code."""
    if verb != "set":
        return dict(args)
    several = [each for each in args.values() if isinstance(each, Mapping)]
    wanted = {str(code): value for each in several for code, value in each.items()}
    return wanted or {str(args.get("parameter")): args.get("value")}


def _as_data(entry: ParameterEntry) -> dict[str, Any]:
    return {"value": entry.value, "label": entry.label, "unit": entry.unit, "raw": list(entry.raw or ())}


VERBS = ("set", "configure")
EVERY_S = 60.0  # one block; an SSW900's settings are some 20 blocks
FIRST_LAP_EVERY_S = 10.0  # until all of them are known: what is changed before cannot be noticed
REFUSALS = 3  # of a row, in as many laps, before it is left out for the rest of the hour
HOUR_S = 3600.0
LONGEST_BLOCK = 24  # registers: no request of an identification is shorter, so no stop waits longer


class ParameterMonitor:
    """Reads the settings of one starter round and round, while it answers and is who it should be."""

    def __init__(
        self,
        starter: PolledStarter,
        *,
        on_change: Callable[[], None] = lambda: None,
        every_s: float = EVERY_S,
    ) -> None:
        self._starter = starter
        self._on_change = on_change
        self._every_s = every_s
        self._watch = watch = ParameterChanges(starter.profile)
        self.recall = watch.recall
        self._reads = list(_lap_of(starter.profile))
        self._left_of_first_lap = len(self._reads)  # blocks: the first lap makes known what there is
        self._refusals: dict[str, int] = {}  # by row, since the hour began
        self._hour_began_s = -inf
        self._task = SupervisedTask(f"keypad {starter.setup.name}")
        self.close = self._task.close

    def start(self) -> None:
        """Begin to walk; once."""
        self._task.begin(self._walk)

    def note_command(self, verb: str, args: Mapping[str, Any], *, is_over: bool) -> None:
        """Record that a command of ours begins or has ended."""
        if verb in VERBS:
            self._watch.note_command(self._starter.variant, verb, args, is_over=is_over)

    def note_reading(self, rows: Mapping[str, tuple[int, ...]]) -> bool:
        """Publish which of these settings, just read, were changed at the starter; return whether any was."""
        starter = self._starter
        changes = self._watch.note_reading(starter.variant, rows)
        for event in changes:
            starter.emitter.event(event)
        return bool(changes)

    async def _walk(self) -> None:
        while self._reads:
            await asyncio.sleep(self._pause_s())
            starter = self._starter
            if not starter.is_answering or starter.identity_standing is not IdentityStatus.MATCHING:
                continue
            self._ask_again_each_hour()
            read = self._reads.pop(0)
            self._left_of_first_lap -= 1
            try:
                self._reads += await self._look(read)
            except (CommandError, PortLostError):  # the polls publish that it is silent
                self._reads.append(read)

    async def _look(self, read: Read) -> tuple[Read, ...]:
        """Read one block and publish what has changed; return what to read next time."""
        starter = self._starter
        ask = partial(starter.ask, lane=Priority.PATROL)
        found = await read_in_bulk(ask, starter.profile, [read], tries=1)
        starter.note_settings(found.rows)
        if self.note_reading(found.rows):
            self._on_change()
        if not found.refused:
            return (read,)
        again = [code for code in found.refused if self._is_asked_again(code)]
        alone = (each for code in again for each in _planned(starter.profile, [code]))
        return (*_planned(starter.profile, found.rows), *alone)

    def _pause_s(self) -> float:
        return min(FIRST_LAP_EVERY_S, self._every_s) if self._left_of_first_lap > 0 else self._every_s

    def _is_asked_again(self, code: str) -> bool:
        """Return whether a row that was refused, each time a lap apart, is asked for in the next lap."""
        count = self._refusals[code] = self._refusals.get(code, 0) + 1
        return count < REFUSALS or code in diagnosis.watchdog_codes(self._starter.profile)

    def _ask_again_each_hour(self) -> None:
        """Ask for everything again that was refused in the hour before."""
        now_s = asyncio.get_running_loop().time()
        if now_s - self._hour_began_s < HOUR_S:
            return
        self._hour_began_s = now_s
        if self._refusals:
            self._refusals.clear()
            self._reads = list(_lap_of(self._starter.profile))


@once_per_profile
def _lap_of(profile: Profile) -> tuple[Read, ...]:
    return _planned(profile, watched_codes(profile))


def _planned(profile: Profile, codes: Iterable[str]) -> tuple[Read, ...]:
    return reading.bulk_reads(profile, codes, longest=min(LONGEST_BLOCK, profile.limits.read_registers // 2))
