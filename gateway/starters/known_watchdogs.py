"""The communication watchdogs of all starters as last known: read, being written, or from an earlier run.

The line keeps a starter from the shortest of: the watchdog that the configuration states, the one last read
from the starter, and the one that a command of ours is writing. What is not known shortens nothing; what was
read in an earlier run counts until it is read again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from math import isinf
from typing import Annotated, TypeVar

from pydantic import Field, TypeAdapter

from gateway.contract import CommandError, EventCode, Note, Reason, ResultCode, phrase
from gateway.families import Procedure, Profile, diagnosis, once_per_profile
from gateway.line import LineClient, Poll, capacity
from gateway.starters.setup import StarterSetup, polls_of
from gateway.store import Documents
from gateway.system.supervised import InThread

WATCHDOGS = "watchdogs"  # the document
SAVED_WITHIN_S = 1.0
SAVED_TOGETHER_S = 1.0  # what is read within so long is saved at once: at a start that of hundreds

Rows = Mapping[str, tuple[int, ...]]  # raw words by code
Word = Annotated[int, Field(ge=0, le=0xFFFF, strict=True)]
T = TypeVar("T")


async def _at_once(work: Callable[[], T]) -> T:
    return work()


@dataclass(slots=True)
class KnownRows:
    """What is known of one starter, whether it is configured at present or not."""

    rows: dict[str, tuple[Word, ...]] = field(default_factory=dict)  # as last read
    written: dict[str, tuple[Word, ...]] = field(default_factory=dict)  # by us, and not read since
    is_being_written: Annotated[bool, Field(exclude=True)] = False


KNOWN_ROWS = TypeAdapter(dict[str, KnownRows])  # by starter


class KnownWatchdogs:
    """Keeps the lines' deadlines, by what an earlier run has saved too. All calls on the app's loop.

    `in_thread` carries out computations of some tenths of a second.
    """

    def __init__(self, documents: Documents | None = None, *, in_thread: InThread = _at_once) -> None:
        self._in_thread = in_thread
        self._setups: dict[str, StarterSetup] = {}  # of those configured at present, in their lines' order
        self._lines: dict[str, LineClient | None] = {}  # by starter
        self._codes: dict[str, frozenset[str]] = {}  # by starter: the rows that say what its watchdog is
        self._given_s: dict[str, float | None] = {}  # by starter: what its line was given
        self._document = (documents or Documents()).open(
            WATCHDOGS, KNOWN_ROWS, self.known, delay_s=SAVED_TOGETHER_S
        )
        self._known = self._document.loaded or {}

    def add(self, setup: StarterSetup, line: LineClient | None = None) -> None:
        """Keep the watchdog of a starter on its line from now on."""
        self._setups[setup.name], self._lines[setup.name] = setup, line
        self._codes[setup.name] = setting_codes(setup.profile)
        self._given_s.pop(setup.name, None)

    def remove(self, name: str) -> None:
        """Know nothing more of a starter than what is stored of it."""
        self._setups.pop(name, None)
        self._lines.pop(name, None)

    def rows(self, name: str) -> Rows:
        """Return the settings as last read, in this run or an earlier one, without what we wrote since."""
        known = self._known.get(name, KnownRows())
        return {code: words for code, words in known.rows.items() if code not in known.written}

    def is_known(self, setup: StarterSetup) -> bool:
        """Return whether something is known of a starter's watchdog, if only that it is off."""
        return setup.watchdog_s is not None or setup.name in self._known

    def limit_s(self, setup: StarterSetup) -> float | None:
        """Return the time of the watchdog that must not act in a starter; None when none is known."""
        known = self._known.get(setup.name)
        if known is None:
            return setup.watchdog_s or None
        rows = [known.rows, {**known.rows, **known.written}]
        return _least(setup.watchdog_s, *(_shortest_s(setup, each) for each in rows))

    def polls(self, setup: StarterSetup) -> tuple[Poll, ...]:
        """Return the polls with which a starter begins, with the deadline that they must meet."""
        limit_s = self.limit_s(setup)
        return tuple(replace(poll, deadline_s=limit_s) for poll in polls_of(setup))

    def note(self, name: str, rows: Rows) -> None:
        """Record settings that were just read, among others the watchdog's."""
        setup = self._setups.get(name)
        if setup is None or self._codes[name].isdisjoint(rows):
            return
        codes = self._codes[name] & rows.keys()
        known = self._known.setdefault(name, KnownRows())
        changed = any(known.rows.get(code) != rows[code] for code in codes)
        known.rows |= {code: rows[code] for code in codes}
        if not known.is_being_written and not codes.isdisjoint(known.written):
            known.written = {code: words for code, words in known.written.items() if code not in codes}
            changed = True
        if changed:
            self._document.touch()
        self._keep(setup)

    async def admit(self, name: str, procedure: Procedure) -> None:
        """Demand that the line can keep the watchdog that a procedure sets; it counts from now on.

        CommandError, with both times, when it cannot; `end` must follow in any case.
        """
        setup = self._setups.get(name)
        written = (
            {}
            if setup is None
            else diagnosis.written_rows(setup.profile, (s.request for s in procedure.steps))
        )
        if setup is None or not written:
            return
        await self._check(setup, written)
        self._keep(setup)
        self._document.touch()
        await self._document.saved(within_s=SAVED_WITHIN_S)

    async def check(self, name: str, rows: Rows) -> None:
        """Demand that the line could keep a starter whose settings were these; CommandError."""
        setup = self._setups.get(name)
        written = {code: words for code, words in rows.items() if code in self._codes.get(name, ())}
        if setup is None or not written:
            return
        try:
            await self._check(setup, written)
        finally:
            self._known[name].written, self._known[name].is_being_written = {}, False

    def end(self, name: str) -> None:
        """Record that a command is over; what it wrote and was not read yet counts until it is read."""
        known = self._known.get(name)
        if known is None or not known.is_being_written:
            return
        known.is_being_written = False
        known.written = {
            code: words for code, words in known.written.items() if known.rows.get(code) != words
        }
        self._document.touch()
        if name in self._setups:
            self._keep(self._setups[name])

    async def gap_s(self, setup: StarterSetup) -> float | None:
        """Return the longest time between two requests to a starter whose line keeps its deadlines."""
        on_line = [each for each in self._setups.values() if each.line == setup.line and each.is_enabled]
        gap_s: float | None = await self._in_thread(
            partial(_gap_s, setup, on_line, self._limits_s(setup.line))
        )
        return gap_s

    async def missed_on(self, setups: Iterable[StarterSetup]) -> dict[str, str]:
        """Return by name, in words, the watchdogs that a line with these starters would miss."""
        found = [setup for setup in setups if setup.is_enabled]
        limits_s = {setup.address: self.limit_s(setup) for setup in found}
        missed: dict[str, str] = await self._in_thread(partial(_missed_on, found, limits_s))
        return missed

    def known(self) -> dict[str, KnownRows]:
        """Return what must outlive the gateway, by starter."""
        return self._known

    async def _check(self, setup: StarterSetup, written: Rows) -> None:
        """Reserve the line's time for what is to be written, or give it back and refuse."""
        known = self._known.setdefault(setup.name, KnownRows())
        before_s = self._limits_s(setup.line)
        earlier = dict(known.written)
        known.written, known.is_being_written = {**known.written, **written}, True
        after_s = self._limits_s(setup.line)
        if after_s == before_s or setup.timing is None:
            return
        on_line = [each for each in self._setups.values() if each.line == setup.line]
        error = await self._in_thread(partial(_refusal, setup, on_line, before_s=before_s, after_s=after_s))
        if error is not None:
            known.written, known.is_being_written = earlier, False
            raise error

    def _limits_s(self, line: str) -> dict[int, float | None]:
        on_line = (setup for setup in self._setups.values() if setup.line == line and setup.is_enabled)
        return {setup.address: self.limit_s(setup) for setup in on_line}

    def _keep(self, setup: StarterSetup) -> None:
        line, limit_s = self._lines[setup.name], self.limit_s(setup)
        if line is None or not setup.is_enabled or self._given_s.get(setup.name, -1.0) == limit_s:
            return
        self._given_s[setup.name] = limit_s
        line.set_deadline(setup.address, limit_s)


@once_per_profile
def setting_codes(profile: Profile) -> frozenset[str]:
    """Return the rows that say what a starter's watchdog is."""
    return frozenset(diagnosis.watchdog_codes(profile))


def _shortest_s(setup: StarterSetup, rows: Rows) -> float | None:
    """Return the watchdog by those rows that this family has: another starter may have had the name."""
    parameters = setup.profile.parameters
    fitting = {
        code: words
        for code, words in rows.items()
        if code in parameters and len(words) == parameters[code].words
    }
    return diagnosis.shortest_s(setup.profile, setup.variant, fitting)


def _least(*limits_s: float | None) -> float | None:
    return min((limit_s for limit_s in limits_s if limit_s), default=None)


def _why(missed: capacity.Missed) -> str:
    if isinf(missed.gap_s):
        return phrase(EventCode.DEGRADED, "watchdog_overload", limit_s=missed.limit_s, load=missed.load)
    return phrase(EventCode.DEGRADED, "watchdog_missed", limit_s=missed.limit_s, gap_s=missed.gap_s)


def _gap_s(setup: StarterSetup, on_line: Sequence[StarterSetup], limits_s: capacity.Limits) -> float | None:
    if setup.timing is None:
        return None
    polls = capacity.with_deadlines([poll for each in on_line for poll in polls_of(each)], limits_s)
    whole = capacity.forecast(polls, setup.timing, allowance_s=setup.allowance_s)
    return whole.gaps_s.get(setup.address)


def _missed_on(setups: Sequence[StarterSetup], limits_s: capacity.Limits) -> dict[str, str]:
    if not setups or setups[0].timing is None:
        return {}
    polls = [poll for setup in setups for poll in polls_of(setup)]
    names = {setup.address: setup.name for setup in setups}
    missed = capacity.missed_deadlines(
        polls, setups[0].timing, allowance_s=setups[0].allowance_s, limits_s=limits_s
    )
    return {names[each.unit]: _why(each) for each in missed}


def _refusal(
    setup: StarterSetup,
    on_line: Iterable[StarterSetup],
    *,
    before_s: capacity.Limits,
    after_s: capacity.Limits,
) -> CommandError | None:
    """Return why a line cannot keep a starter's new watchdog, and the shortest it can; None when it can."""
    names = {each.address: each.name for each in on_line}
    polls = [poll for each in on_line for poll in polls_of(each)]
    if setup.timing is None:
        return None
    allowance_s = setup.allowance_s
    missed = capacity.newly_missed(
        polls, setup.timing, allowance_s=allowance_s, before_s=before_s, after_s=after_s
    )
    if not missed:
        return None
    first = min(missed, key=lambda each: each.unit != setup.address)  # its own goes before others'
    shortest_s = capacity.shortest_limit_s(
        polls, setup.timing, allowance_s=allowance_s, before_s=before_s, unit=setup.address
    )
    name, limit_s = names[first.unit], first.limit_s
    if isinf(first.gap_s):
        reason = Reason(ResultCode.WATCHDOG_UNKEPT, "load", starter=name, limit_s=limit_s, load=first.load)
    else:
        reason = Reason(ResultCode.WATCHDOG_UNKEPT, "gap", starter=name, limit_s=limit_s, gap_s=first.gap_s)
    if shortest_s is None:
        return CommandError(reason.noted(Note("watchdog_off", starter=setup.name)))
    return CommandError(reason.noted(Note("watchdog_shortest", starter=setup.name, shortest_s=shortest_s)))
