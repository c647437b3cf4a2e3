"""All that the gateway knows and remembers to judge commands by, beyond the starters' own readings."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gateway.contract import (
    CommandError,
    CommandRequest,
    LockRecord,
    Record,
    RecordWriter,
    ResultCode,
    StateRecord,
)
from gateway.errors import DamagedError
from gateway.families import Procedure
from gateway.starters.identity import IdentityRegistry
from gateway.starters.known_watchdogs import KnownWatchdogs
from gateway.starters.policy.motor_history import LOCKS, MOTORS, MotorHistory, StoredMotors
from gateway.starters.policy.preconditions import Expectation, demand_unlocked
from gateway.starters.policy.rights import Rights
from gateway.starters.policy.selection import Selections
from gateway.starters.policy.start_rules import PolicySettings, demand_start, is_start
from gateway.starters.policy.write_budget import WriteBudget
from gateway.starters.state import PublishedFaults
from gateway.store import Documents, read_document, write_document
from gateway.system.clock import ClockReading

SAVED_WITHIN_S = 1.0  # a start, where a rule counts starts
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
        documents: Documents,
    ) -> None:
        self.settings = settings
        self.rights = rights
        self.motor_history = MotorHistory()
        self.selections = Selections()
        self.identities = IdentityRegistry(records, documents)
        self.published_faults = PublishedFaults(documents)
        self.watchdogs = KnownWatchdogs(documents)
        self.write_budget = WriteBudget(records, documents)
        self.document = documents.open(LOCKS, MOTORS, self._stored)
        self.clock = records.clock
        self._unsure: set[str] = set()  # starters that may have been locked, as far as anybody knows
        if self.document.loaded is not None:
            self.motor_history.restore(
                self.document.loaded, now_s=self.clock.now_s(), reading=self.clock.reading()
            )
        elif self.document.damage:  # lock each starter that somebody may unlock
            self._unsure = set(starters)
            self._lock_unsure()
        self.motor_history.on_change = self.document.touch

    def put(self, record: Record) -> None:
        """Remember the states that are published."""
        if isinstance(record, StateRecord):
            self.motor_history.note_state(record.starter, record.state, now_s=self.clock.now_s())

    def apply(self, settings: PolicySettings, *, rights: Rights) -> list[str]:
        """Judge by other settings now, also what is not yet written; return the starters locked by it."""
        self.settings, self.rights = settings, rights
        return self._lock_unsure()

    def _stored(self) -> StoredMotors:
        return self.motor_history.stored(now_s=self.clock.now_s(), reading=self.clock.reading())

    def _lock_unsure(self) -> list[str]:
        """Lock what may have been locked, where somebody may unlock it; return those starters."""
        locked = [name for name in self._unsure if self.rights.is_lockable(name)]
        self._unsure.difference_update(locked)
        reason = "the memory of locks was damaged: look, then unlock"
        for name in locked:
            self.motor_history.set_lock(name, _own_lock(self.clock.utc_s(), reason))
        return locked


@dataclass(slots=True)
class Guard:
    """Judges one command until its first write; what judges raises CommandError when it must not be."""

    request: CommandRequest
    policy: Policy
    expectations: Sequence[Expectation] = ()
    _is_counted: bool = False  # the start, in the motor history: it must not stand in its own way

    @property
    def codes(self) -> tuple[str, ...]:
        """Return the rows that must be read besides those of the command itself."""
        return tuple(code for expectation in self.expectations for code in expectation.codes)

    @property
    def _is_start(self) -> bool:
        return is_start(self.request.verb, self.request.args)

    def check(self, points: Mapping[str, Any] | None = None) -> None:
        """Judge by the gateway's own rules, and by fresh points where there are some."""
        demand_unlocked(self.request, self.policy.motor_history)
        if points is not None:
            for expectation in self.expectations:
                expectation.check(points)
        if self._is_start and not self._is_counted:
            policy = self.policy
            now_s = policy.clock.now_s()
            demand_start(policy.settings, policy.motor_history, self.request.starter, now_s=now_s)

    async def admit(self, procedure: Procedure) -> None:
        """Judge for the last time, and count the start and the writes to the starter's memory; `end` follows.

        The line must keep the watchdog that is set. Where a rule counts starts, the start is stored first.
        """
        policy, starter = self.policy, self.request.starter
        await policy.watchdogs.admit(starter, procedure)
        self.check()
        if self._is_start:
            self._is_counted = True
            policy.motor_history.note_start(starter, now_s=policy.clock.now_s())
            if policy.settings.of(starter).is_counting:
                if not await policy.document.saved(within_s=SAVED_WITHIN_S):
                    raise CommandError(ResultCode.NOT_KEPT, "start")
                demand_unlocked(self.request, policy.motor_history)
        if procedure.wears:
            policy.write_budget.take(starter, procedure.wears, now_s=policy.clock.now_s())

    def end(self, *, is_written: bool) -> None:
        """Record that the command is over: a watchdog that it may have written counts until it is read."""
        self.policy.watchdogs.end(self.request.starter, is_written=is_written)


def lock_restored(
    path: Path,
    names: Sequence[str],
    *,
    is_lockable: Callable[[str], bool],
    reading: ClockReading,
    reason: str,
) -> list[str]:
    """Lock each starter that can be in a state that was put back; return those locked by it. StoreError.

    Locks that were set since are not known. Starts are as old as they were, and age by this machine's clocks.
    """
    try:
        stored = read_document(path, LOCKS, MOTORS)
    except DamagedError:
        stored = None
    history, here = MotorHistory(), reading
    if stored is not None:
        here = ClockReading(reading.up_s, stored.at.utc_s, reading.boot_id)
        # Its times as they are, read by the clocks of this machine
        history.restore(stored.model_copy(update={"at": here}), now_s=here.up_s, reading=here)
    locked = [name for name in names if is_lockable(name) and history.lock_of(name) is None]
    for name in locked:
        history.set_lock(name, _own_lock(reading.utc_s, reason))
    if stored is not None or locked:
        write_document(path, LOCKS, MOTORS, history.stored(now_s=here.up_s, reading=here))
    return locked


def _own_lock(since_s: float, reason: str) -> LockRecord:
    return LockRecord(by=GATEWAY, since_s=since_s, reason=reason)
