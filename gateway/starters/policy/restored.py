"""Locks after a backup was put back: those that were set since are not known, so every motor is locked.

Starts are as old as they were in the backup, and age by this machine's clocks from now on.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from gateway.contract import LockRecord
from gateway.errors import DamagedError
from gateway.starters.policy.motor_history import LOCKS, MOTORS, MotorHistory, StoredMotors
from gateway.starters.policy.policy import GATEWAY
from gateway.store import read_document, write_document
from gateway.system.clock_steps import ClockReading


def lock_restored(
    path: Path,
    names: Sequence[str],
    *,
    is_lockable: Callable[[str], bool],
    reading: ClockReading,
    reason: str,
) -> list[str]:
    """Lock each starter that can be in the file of a state; return those locked by it. StoreError."""
    try:
        stored = read_document(path, LOCKS, MOTORS)
    except DamagedError:
        stored = None
    history, here = MotorHistory(names), reading
    if stored is not None:
        here = ClockReading(reading.up_s, stored.at.utc_s, reading.boot_id)
        history.restore(_moved(stored, here), now_s=here.up_s, reading=here)
    locked = [name for name in names if is_lockable(name) and history.lock_of(name) is None]
    for name in locked:
        history.set_lock(name, LockRecord(by=GATEWAY, since_s=reading.utc_s, reason=reason))
    if stored is not None or locked:
        write_document(path, LOCKS, MOTORS, history.stored(now_s=here.up_s, reading=here))
    return locked


def _moved(stored: StoredMotors, here: ClockReading) -> StoredMotors:
    """Return the same with its times as they are, and read by the clocks of this machine."""
    at = stored.at.model_copy(update={"up_s": here.up_s, "boot_id": here.boot_id})
    return stored.model_copy(update={"at": at})
