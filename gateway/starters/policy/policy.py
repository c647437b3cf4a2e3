"""All that the gateway knows and remembers to judge commands by, beyond the starters' own readings.

Stands between the starters and the sink: keeps the states that pass in the logbook, and adds the locks.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any

from gateway.errors import DamagedError
from gateway.records import EventRecord, LockRecord, Record, SequenceNumbers, Severity, Sink, StateRecord
from gateway.starters.identity.registry import IdentityRegistry
from gateway.starters.policy.lock import NOTICE
from gateway.starters.policy.motor_history import MotorHistory
from gateway.starters.policy.preconditions import Expectation, Guard
from gateway.starters.policy.request import CommandRequest
from gateway.starters.policy.rights import Rights
from gateway.starters.policy.selection import Selections
from gateway.starters.policy.start_rules import PolicySettings, Rulebook
from gateway.starters.policy.write_budget import WriteBudget
from gateway.starters.telemetry.known_watchdogs import KnownWatchdogs
from gateway.starters.telemetry.transitions import PublishedFaults
from gateway.storage.json_file import JsonStore, NoStore, Saver
from gateway.system.clock import Clock


class StateObserver:
    """A sink for the records of starters; `on_change` hears when the logbook has something new to keep."""

    def __init__(
        self,
        sink: Sink,
        logbook: MotorHistory,
        *,
        clock: Clock,
        sequence: SequenceNumbers,
        on_change: Callable[[], None],
    ) -> None:
        self._sink = sink
        self._logbook = logbook
        self._clock = clock
        self._sequence = sequence
        self._on_change = on_change
        self._states: dict[str, StateRecord] = {}

    def put(self, record: Record) -> None:
        """Pass a record on; a state with its starter's lock."""
        if not isinstance(record, StateRecord):
            self._sink.put(record)
            return
        if self._logbook.note_state(record.starter, record.state, now_s=self._clock.now_s()):
            self._on_change()
        self._states[record.starter] = record
        self._tell(record)

    def restate(self, starter: str) -> None:
        """Tell the state of a starter again, because its lock has changed."""
        record = self._states.get(starter)
        if record is not None:
            self._tell(replace(record, seq=self._sequence.take()))

    def _tell(self, record: StateRecord) -> None:
        self._sink.put(replace(record, is_lock_known=True, lock=self._logbook.lock_of(record.starter)))


WEAR_EVENT = "memory_written"
GATEWAY = "gateway"  # who locks when the locks are not known any more


class Policy:
    """The policy with the logbook, which is read when this is made: before any command is judged."""

    def __init__(
        self,
        policy: PolicySettings,
        starters: Collection[str],
        *,
        rights: Rights,
        sink: Sink,
        clock: Clock,
        sequence: SequenceNumbers,
        memory: JsonStore | None = None,
        identities_memory: JsonStore | None = None,
        wear_memory: JsonStore | None = None,
        watchdogs: KnownWatchdogs | None = None,
        told_faults: PublishedFaults | None = None,
    ) -> None:
        self.policy = policy
        self.logbook = MotorHistory(starters)
        self.rulebook = Rulebook(policy.rules, self.logbook)
        self.selections = Selections()
        self.identities = IdentityRegistry(
            sink=sink, clock=clock, sequence=sequence, memory=identities_memory
        )
        self.told_faults = told_faults or PublishedFaults()
        self.watchdogs = watchdogs or KnownWatchdogs()
        self.wear = WriteBudget(on_count=self._tell_wear)
        self._wear_saver = Saver(wear_memory or NoStore(), self.wear.to_document, on_trouble=lambda _: None)
        self.saver = Saver(memory or NoStore(), self._document, on_trouble=self._tell_trouble)
        self.witness = StateObserver(
            sink, self.logbook, clock=clock, sequence=sequence, on_change=self.saver.touch
        )
        self._sink = sink
        self._clock = clock
        self._sequence = sequence
        self._unsure: set[str] = set()  # starters that may have been locked, as far as anybody knows
        self._restore(memory or NoStore(), starters, rights)
        self._restore_wear(wear_memory or NoStore())
        if self.watchdogs.damage:
            self._tell("memory_damaged", Severity.WARNING, self.watchdogs.damage)

    def take_over(self, policy: PolicySettings, *, rights: Rights) -> None:
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

    def _restore(self, memory: JsonStore, starters: Collection[str], rights: Rights) -> None:
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

    def _restore_wear(self, memory: JsonStore) -> None:
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
