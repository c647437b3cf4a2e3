"""The communication watchdogs of all starters as last known: read, from an earlier run, or admitted.

The line keeps a starter from the shorter of two: the watchdog that the configuration states, and the one by
its rows. A `set` that makes it shorter is admitted only if the line can keep it, and counts from then on,
whatever is read of the old one before it is written. After the command's end it counts until the next
reading, such as the look at the readiness that follows each write; if nothing was written, not at all.
"""

from __future__ import annotations

import asyncio
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache, partial
from math import isinf
from typing import Annotated

from pydantic import Field, TypeAdapter

from gateway.contract import CommandError, Note, Reason, ResultCode
from gateway.families import Procedure, Profile, diagnosis
from gateway.line import LineClient, capacity
from gateway.modbus import LineTiming
from gateway.starters.setup import StarterSetup, polls_of
from gateway.store import Documents

WATCHDOGS = "watchdogs"  # the document
SAVED_TOGETHER_S = 1.0  # what is read within so long is saved at once: at a start that of hundreds

Rows = Mapping[str, tuple[int, ...]]  # raw words by code
Word = Annotated[int, Field(ge=0, le=0xFFFF, strict=True)]
OnLine = tuple[tuple[StarterSetup, float | None], ...]  # the starters of a line with their watchdogs


@dataclass(slots=True)
class KnownRows:
    """What is known of one starter, whether it is configured at present or not."""

    rows: dict[str, tuple[Word, ...]] = field(default_factory=dict)


_UNKNOWN = (None, None)
KNOWN_ROWS = TypeAdapter(dict[str, KnownRows])  # by starter


class KnownWatchdogs:
    """Keeps the lines' deadlines, by what an earlier run has saved too. All calls on the app's loop."""

    def __init__(self, documents: Documents) -> None:
        self._starters: dict[str, tuple[StarterSetup, LineClient]] = {}  # in their lines' order
        # By starter: the rows of a `set` under way that were not read yet.
        self._admitted: dict[str, dict[str, tuple[int, ...]]] = {}
        self._document = documents.open(WATCHDOGS, KNOWN_ROWS, self.known, delay_s=SAVED_TOGETHER_S)
        self._known = self._document.loaded or {}

    def add(self, setup: StarterSetup, line: LineClient) -> None:
        """Keep the watchdog of a starter on its line from now on."""
        self._starters[setup.name] = setup, line

    def remove(self, name: str) -> None:
        """Know nothing more of a starter than what is stored of it."""
        self._starters.pop(name, None)

    def known(self) -> dict[str, KnownRows]:
        """Return what must outlive the gateway, by starter: what is admitted may be written by now."""
        written = {name: KnownRows({**self.rows(name), **rows}) for name, rows in self._admitted.items()}
        return {**self._known, **written}

    def rows(self, name: str) -> Rows:
        """Return the settings as last known, in this run or an earlier one."""
        return self._known.get(name, KnownRows()).rows

    def is_known(self, setup: StarterSetup) -> bool:
        """Return whether something is known of a starter's watchdog, if only that it is off."""
        return setup.watchdog_s is not None or setup.name in self._known

    def limit_s(self, setup: StarterSetup) -> float | None:
        """Return the time of the watchdog that must not act in a starter; None when none is known."""
        rows, admitted = self.rows(setup.name), self._admitted.get(setup.name, {})
        limits_s = _limit_s(setup, rows), _limit_s(setup, {**rows, **admitted})
        return min((limit_s for limit_s in limits_s if limit_s), default=None)

    def note(self, name: str, rows: Rows) -> None:
        """Record settings that were just read, among others the watchdog's."""
        setup, _ = self._starters.get(name, _UNKNOWN)
        found = {} if setup is None else _watchdog_rows(setup.profile, rows)
        if not found:
            return
        admitted = self._admitted.get(name, {})
        for code in [code for code, words in admitted.items() if found.get(code) == words]:
            del admitted[code]
        known = KnownRows({**self.rows(name), **found})
        if known != self._known.get(name):
            self._known[name] = known
            self._keep(name)

    async def admit(self, name: str, procedure: Procedure) -> None:
        """Demand that the line can keep the watchdog that a procedure sets; a shorter one counts from now on.

        CommandError, with both times, when it cannot; `end` must follow in any case.
        """
        setup, _ = self._starters.get(name, _UNKNOWN)
        if setup is None:
            return
        requests, before = (step.request for step in procedure.steps), self._on_line(setup)
        written = _watchdog_rows(setup.profile, diagnosis.written_rows(setup.profile, requests))
        limit_s, earlier_s = _limit_s(setup, {**self.rows(name), **written}), self.limit_s(setup)
        if not limit_s or (earlier_s and limit_s >= earlier_s):
            return  # the line keeps a longer one, too, until that is read
        self._admitted[name] = dict(written)  # before it is judged: another `set` on this line must see it
        self._keep(name)
        error = await asyncio.to_thread(_refusal, setup, before, limit_s)
        if error is not None:
            self.end(name, is_written=False)
            raise error

    def end(self, name: str, *, is_written: bool) -> None:
        """Record that a command is over; what it may have written counts until it is read."""
        admitted = self._admitted.pop(name, None)
        if admitted is not None:
            if is_written:
                self._known[name] = KnownRows({**self.rows(name), **admitted})
            self._keep(name)

    async def gap_s(self, setup: StarterSetup) -> float | None:
        """Return the longest time between two requests to a starter whose line keeps its deadlines."""
        whole = await asyncio.to_thread(_forecast, setup.timing, setup.allowance_s, self._on_line(setup))
        return whole.gaps_s.get(setup.address)

    async def missed_on(self, setups: Iterable[StarterSetup]) -> dict[str, str]:
        """Return by name, in words, the watchdogs that a line with these starters would miss."""
        on_line = tuple((setup, self.limit_s(setup)) for setup in setups)
        first, _ = on_line[0]
        whole = await asyncio.to_thread(_forecast, first.timing, first.allowance_s, on_line)
        names = {setup.address: setup.name for setup, _ in on_line}
        return {names[each.unit]: _unkept(each, names[each.unit]).text for each in whole.missed}

    def _keep(self, name: str) -> None:
        """Have what is known now held by the starter's line and on the disk."""
        self._document.touch()
        setup, line = self._starters.get(name, _UNKNOWN)
        if setup is not None and line is not None and setup.is_enabled:
            line.set_deadline(setup.address, self.limit_s(setup))

    def _on_line(self, setup: StarterSetup) -> OnLine:
        """Return the starters of this one's line with their watchdogs."""
        setups = [each for each, _ in self._starters.values() if each.line == setup.line]
        return tuple((each, self.limit_s(each)) for each in setups)


def _watchdog_rows(profile: Profile, rows: Rows) -> Rows:
    """Return those of the rows that say what a starter's watchdog is."""
    return {code: rows[code] for code in diagnosis.watchdog_codes(profile) if code in rows}


def _limit_s(setup: StarterSetup, rows: Rows) -> float | None:
    """Return the shortest watchdog of a starter, by those rows that this family has.

    Another starter may have had the name.
    """
    parameters = setup.profile.parameters
    fitting = {
        code: words
        for code, words in rows.items()
        if code in parameters and len(words) == parameters[code].words
    }
    read_s = diagnosis.shortest_s(setup.profile, setup.variant, fitting)
    return min((limit_s for limit_s in (setup.watchdog_s, read_s) if limit_s), default=None)


@lru_cache(maxsize=8)  # each starter of a line asks for it: with 247 it takes 50 ms and 1 MB
def _forecast(timing: LineTiming, allowance_s: float, on_line: OnLine) -> capacity.Forecast:
    """Return what a line with these starters is like."""
    polls = [poll for each, limit_s in on_line for poll in polls_of(each, limit_s)]
    return capacity.forecast(polls, timing, allowance_s=allowance_s)


def _unkept(missed: capacity.Missed, starter: str) -> Reason:
    """Return why a watchdog would act."""
    limit_s = missed.limit_s
    if isinf(missed.gap_s):
        return Reason(ResultCode.WATCHDOG_UNKEPT, "load", starter=starter, limit_s=limit_s, load=missed.load)
    return Reason(ResultCode.WATCHDOG_UNKEPT, "gap", starter=starter, limit_s=limit_s, gap_s=missed.gap_s)


def _refusal(setup: StarterSetup, before: OnLine, limit_s: float) -> CommandError | None:
    """Return why a line cannot keep a starter's shorter watchdog, and the shortest it can; None when it can.

    Another's that is missed already speaks against no change.
    """
    names = {each.address: each.name for each, _ in before}
    forecast = partial(_forecast, setup.timing, setup.allowance_s)
    known = {each.unit for each in forecast(before).missed} - {setup.address}

    def missed(limit_s: float) -> list[capacity.Missed]:
        after = tuple((each, limit_s if each is setup else its_s) for each, its_s in before)
        return [each for each in forecast(after).missed if each.unit not in known]

    found = missed(limit_s)
    if not found:
        return None
    first = min(found, key=lambda each: each.unit != setup.address)  # its own goes before others'
    shortest_s = capacity.least_whole(lambda limit_s: not missed(limit_s))
    note = Note("watchdog_off", starter=setup.name)
    if shortest_s is not None:
        note = Note("watchdog_shortest", starter=setup.name, shortest_s=shortest_s)
    return CommandError(_unkept(first, names[first.unit]).noted(note))
