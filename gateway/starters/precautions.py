"""All that the gateway knows and remembers to judge commands by, beyond the starters' own readings."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

from gateway.clock import Clock
from gateway.errors import DamagedError
from gateway.starters.expectation import Expectation
from gateway.starters.guard import Guard
from gateway.starters.identities import Identities
from gateway.starters.known_watchdogs import KnownWatchdogs
from gateway.starters.logbook import Logbook
from gateway.starters.maintenance import NOTICE
from gateway.starters.memory import Memory, NoMemory, Saver
from gateway.starters.policy import Policy
from gateway.starters.records import EventRecord, LockRecord, Severity, Sink
from gateway.starters.request import CommandRequest
from gateway.starters.rights import Rights
from gateway.starters.rules import Rulebook
from gateway.starters.selection import Selections
from gateway.starters.sequence import Sequence as Numbers
from gateway.starters.told_faults import ToldFaults
from gateway.starters.wear import Wear
from gateway.starters.witness import Witness

WEAR_EVENT = "memory_written"
GATEWAY = "gateway"  # who locks when the locks are not known any more


class Precautions:
    """The policy with the logbook, which is read when this is made: before any command is judged."""

    def __init__(
        self,
        policy: Policy,
        starters: Collection[str],
        *,
        rights: Rights,
        sink: Sink,
        clock: Clock,
        sequence: Numbers,
        memory: Memory | None = None,
        identities_memory: Memory | None = None,
        wear_memory: Memory | None = None,
        watchdogs: KnownWatchdogs | None = None,
        told_faults: ToldFaults | None = None,
    ) -> None:
        self.policy = policy
        self.logbook = Logbook(starters)
        self.rulebook = Rulebook(policy.rules, self.logbook)
        self.selections = Selections()
        self.identities = Identities(sink=sink, clock=clock, sequence=sequence, memory=identities_memory)
        self.told_faults = told_faults or ToldFaults()
        self.watchdogs = watchdogs or KnownWatchdogs()
        self.wear = Wear(on_count=self._tell_wear)
        self._wear_saver = Saver(wear_memory or NoMemory(), self.wear.to_document, on_trouble=lambda _: None)
        self.saver = Saver(memory or NoMemory(), self._document, on_trouble=self._tell_trouble)
        self.witness = Witness(sink, self.logbook, clock=clock, sequence=sequence, on_change=self.saver.touch)
        self._sink = sink
        self._clock = clock
        self._sequence = sequence
        self._unsure: set[str] = set()  # starters that may have been locked, as far as anybody knows
        self._restore(memory or NoMemory(), starters, rights)
        self._restore_wear(wear_memory or NoMemory())
        if self.watchdogs.damage:
            self._tell("memory_damaged", Severity.WARNING, self.watchdogs.damage)

    def take_over(self, policy: Policy, *, rights: Rights) -> None:
        """Judge by another policy from now on; a command that was admitted keeps to the one it came under."""
        self.policy = policy
        self.rulebook = Rulebook(policy.rules, self.logbook)
        self._lock_unsure(rights)
        self.saver.touch()
        self.identities.keep()

    def guard(self, request: CommandRequest, expectations: Sequence[Expectation]) -> Guard:
        """Return what watches over one command until its write."""
        return Guard(
            request,
            expectations,
            logbook=self.logbook,
            rulebook=self.rulebook,
            saver=self.saver,
            clock=self._clock,
        )

    def _document(self) -> dict[str, object]:
        return self.logbook.to_document(now_s=self._clock.now_s(), reading=self._clock.reading())

    def _restore(self, memory: Memory, starters: Collection[str], rights: Rights) -> None:
        """Take over what was kept; where that is lost, nobody knows what was locked: all that can be is."""
        now_s, reading = self._clock.now_s(), self._clock.reading()
        try:
            document = memory.load()
            if document is not None:
                self.logbook.restore(document, now_s=now_s, reading=reading)
        except DamagedError as error:
            memory.set_aside()
            self._unsure = set(starters)
            count = self._lock_unsure(rights)
            text = f"{error}: earlier starts are not known, and {count} starters are locked ({NOTICE})"
            self._tell("memory_damaged", Severity.ERROR, text)

    def _restore_wear(self, memory: Memory) -> None:
        try:
            document = memory.load()
            if document is not None:
                self.wear.restore(document)
        except DamagedError as error:
            memory.set_aside()
            self._tell("memory_damaged", Severity.WARNING, f"{error}: they begin at 0 again")

    def _tell_wear(self, starter: str, text: str) -> None:
        """Say and keep how often a starter's memory was written; nobody need hear that a count is lost."""
        self._wear_saver.touch()
        data = {"last_hour": self.wear.last_hour(starter), "total": self.wear.total(starter)}
        self._tell(WEAR_EVENT, Severity.INFO, text, starter, data)

    def _lock_unsure(self, rights: Rights) -> int:
        """Lock what may have been locked, where somebody may unlock it; return how many starters that is."""
        locked = [name for name in self._unsure if rights.is_lockable(name)]
        reason = "the memory of locks was damaged: look, then unlock"
        for name in locked:
            self._unsure.discard(name)
            self.logbook.set_lock(name, LockRecord(GATEWAY, self._clock.utc_s(), reason))
            self.witness.restate(name)
        return len(locked)

    def _tell_trouble(self, trouble: str) -> None:
        if trouble:
            self._tell("memory_away", Severity.ERROR, f"locks and starts cannot be kept: {trouble}")
        else:
            self._tell("memory_back", Severity.INFO, "locks and starts are kept again")

    def _tell(
        self,
        code: str,
        severity: Severity,
        text: str,
        starter: str = "",
        data: Mapping[str, Any] | None = None,
    ) -> None:
        utc_s, seq = self._clock.utc_s(), self._sequence.take()
        self._sink.put(EventRecord(starter, code, severity, text, utc_s, seq, data or {}))
