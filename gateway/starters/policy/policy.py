"""All that the gateway knows and remembers to judge commands by, beyond the starters' own readings."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from gateway.contract import CommandRequest, LockRecord, Record, RecordWriter, Severity, StateRecord
from gateway.errors import DamagedError
from gateway.starters.identity.registry import IdentityRegistry
from gateway.starters.policy.motor_history import MotorHistory
from gateway.starters.policy.preconditions import NOTICE, Expectation, Guard
from gateway.starters.policy.rights import Rights
from gateway.starters.policy.selection import Selections
from gateway.starters.policy.start_rules import PolicySettings, Rulebook
from gateway.starters.policy.write_budget import WriteBudget
from gateway.starters.telemetry.known_watchdogs import KnownWatchdogs
from gateway.starters.telemetry.transitions import PublishedFaults
from gateway.storage.json_file import JsonStore, NoStore, Saver

WEAR_EVENT = "memory_written"
GATEWAY = "gateway"  # who writes by itself, and locks when the locks are not known any more


class Policy:
    """Settings, rights and history to judge commands by; what was stored is read here, before any command.

    Subscribes to the records: starts and standstills are what the published states say.
    """

    takes = (StateRecord,)

    def __init__(
        self,
        settings: PolicySettings,
        starters: Collection[str],
        *,
        rights: Rights,
        records: RecordWriter,
        memory: JsonStore | None = None,
        identities_memory: JsonStore | None = None,
        write_budget_memory: JsonStore | None = None,
        watchdogs: KnownWatchdogs | None = None,
        published_faults: PublishedFaults | None = None,
    ) -> None:
        self.settings = settings
        self.motor_history = MotorHistory(starters)
        self.rulebook = Rulebook(settings.rules, self.motor_history)
        self.selections = Selections()
        self.identities = IdentityRegistry(records, identities_memory)
        self.published_faults = published_faults or PublishedFaults()
        self.watchdogs = watchdogs or KnownWatchdogs()
        self.write_budget = WriteBudget(on_count=self._publish_write_count)
        self._write_budget_saver = Saver(
            write_budget_memory or NoStore(), self.write_budget.to_document, on_trouble=lambda _: None
        )
        self.saver = Saver(memory or NoStore(), self._document, on_trouble=self._publish_trouble)
        self._clock = records.clock
        self._records = records
        self._unsure: set[str] = set()  # starters that may have been locked, as far as anybody knows
        self._restore(memory or NoStore(), starters, rights)
        self._restore_write_budget(write_budget_memory or NoStore())
        if self.watchdogs.damage:
            self._records.event("", "memory_damaged", Severity.WARNING, self.watchdogs.damage)

    def put(self, record: Record) -> None:
        """Remember the states that are published."""
        if isinstance(record, StateRecord) and self.motor_history.note_state(
            record.starter, record.state, now_s=self._clock.now_s()
        ):
            self.saver.touch()

    def apply(self, settings: PolicySettings, *, rights: Rights) -> list[str]:
        """Judge by other settings from now on; return the starters that are locked by it.

        A command that was admitted keeps to the settings it was admitted under.
        """
        self.settings = settings
        self.rulebook = Rulebook(settings.rules, self.motor_history)
        locked = self._lock_unsure(rights)
        self.saver.touch()
        self.identities.store()
        return locked

    def guard(self, request: CommandRequest, expectations: Sequence[Expectation]) -> Guard:
        """Return what watches over one command until its write."""
        return Guard(
            request,
            expectations,
            motor_history=self.motor_history,
            rulebook=self.rulebook,
            saver=self.saver,
            clock=self._clock,
        )

    def _document(self) -> dict[str, object]:
        return self.motor_history.to_document(now_s=self._clock.now_s(), reading=self._clock.reading())

    def _restore(self, memory: JsonStore, starters: Collection[str], rights: Rights) -> None:
        """Apply what was stored; where that is damaged, lock each starter that somebody may unlock."""
        now_s, reading = self._clock.now_s(), self._clock.reading()
        try:
            document = memory.load()
            if document is not None:
                self.motor_history.restore(document, now_s=now_s, reading=reading)
        except DamagedError as error:
            memory.set_aside()
            self._unsure = set(starters)
            count = len(self._lock_unsure(rights))
            text = f"{error}: earlier starts are not known, and {count} starters are locked ({NOTICE.text})"
            self._records.event("", "memory_damaged", Severity.ERROR, text)

    def _restore_write_budget(self, memory: JsonStore) -> None:
        try:
            document = memory.load()
            if document is not None:
                self.write_budget.restore(document)
        except DamagedError as error:
            memory.set_aside()
            self._records.event("", "memory_damaged", Severity.WARNING, f"{error}: they begin at 0 again")

    def _publish_write_count(self, starter: str, text: str) -> None:
        """Publish and store how often a starter's memory was written; a lost count is no event."""
        self._write_budget_saver.touch()
        data = {"last_hour": self.write_budget.last_hour(starter), "total": self.write_budget.total(starter)}
        self._records.event(starter, WEAR_EVENT, Severity.INFO, text, data)

    def _lock_unsure(self, rights: Rights) -> list[str]:
        """Lock what may have been locked, where somebody may unlock it; return those starters."""
        locked = [name for name in self._unsure if rights.is_lockable(name)]
        reason = "the memory of locks was damaged: look, then unlock"
        for name in locked:
            self._unsure.discard(name)
            self.motor_history.set_lock(
                name, LockRecord(by=GATEWAY, since_s=self._clock.utc_s(), reason=reason)
            )
        return locked

    def _publish_trouble(self, trouble: str) -> None:
        if trouble:
            text = f"locks and starts cannot be stored: {trouble}"
            self._records.event("", "memory_away", Severity.ERROR, text)
        else:
            self._records.event("", "memory_back", Severity.INFO, "locks and starts are stored again")
