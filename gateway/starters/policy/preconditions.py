"""What must hold right before a write: what the operator expects, and what the gateway demands.

A maintenance lock forbids all that could move the motor; it replaces no physical lock.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from gateway.contract import CommandError, CommandRequest, LockRecord, Note, Reason, ResultCode
from gateway.families import STATES, Profile, command, reading, state_of
from gateway.starters.policy.motor_history import MotorHistory
from gateway.starters.policy.start_rules import is_release

STATE = "state"
NOTICE = Note("no_physical_lock")
LONGEST_REASON = 256
_HARMLESS = frozenset({"read", "reset", "stop"})  # a reset takes a standing run command back first


@dataclass(frozen=True, slots=True)
class Expectation:
    """A state, or the values of points, that must still be so; CommandError for what cannot be."""

    profile: Profile
    wanted: Mapping[str, Any]
    code: ResultCode = ResultCode.NOT_AS_EXPECTED  # of a refusal

    def __post_init__(self) -> None:
        for name, value in self.wanted.items():
            if name != STATE and name not in self.profile.points:
                raise CommandError(ResultCode.BAD_EXPECT, "point", title=self.profile.title, name=name[:40])
            if name == STATE and value not in STATES:
                raise CommandError(ResultCode.BAD_EXPECT, "state", states=", ".join(STATES))

    @property
    def codes(self) -> tuple[str, ...]:
        """Return the rows that must be read to judge."""
        names = [name for name in self.wanted if name != STATE]
        if STATE in self.wanted:
            names += command.points_needed(self.profile, ("is_ready",))
        return reading.rows_of_points(self.profile, names)

    def check(self, points: Mapping[str, Any]) -> None:
        """Raise CommandError unless all is as expected."""
        for name, wanted in self.wanted.items():
            value = state_of(self.profile, points) if name == STATE else points.get(name)
            if not _is_equal(value, wanted):
                raise CommandError(self.code, name=name, value=_word(value), wanted=_word(wanted))


def _is_equal(value: object, wanted: object) -> bool:
    return isinstance(value, bool) is isinstance(wanted, bool) and value == wanted


def _word(value: object) -> str:
    if value is None:
        return "unknown"
    return str(value).lower() if isinstance(value, bool) else str(value)


def is_forbidden(verb: str, args: Mapping[str, Any]) -> bool:
    """Return whether a lock forbids a command: all but reading, resetting, stopping and releasing."""
    return verb not in _HARMLESS and not is_release(verb, args)


def refusal(lock: LockRecord) -> CommandError:
    """Return why a command is refused while this lock stands."""
    reason = Reason(ResultCode.LOCKED, "lock", owner=owner_of(lock), reason=lock.reason)
    return CommandError(reason.noted(NOTICE))


def demand_unlocked(request: CommandRequest, motor_history: MotorHistory) -> None:
    """Raise CommandError for what the lock of its starter forbids."""
    lock = motor_history.lock_of(request.starter)
    if lock is not None and is_forbidden(request.verb, request.args):
        raise refusal(lock)


def owner_of(lock: LockRecord) -> str:
    """Return who set a lock, for people."""
    return f"{lock.by} ({lock.operator})" if lock.operator else lock.by


def reason_in(args: Mapping[str, Any], reason: str | None) -> str:
    """Return why someone locks: the argument `reason`, else the command's; CommandError without one."""
    why = args.get("reason", reason)
    if not isinstance(why, str) or not why.strip():
        raise CommandError(ResultCode.BAD_ARGUMENTS, "reason_missing")
    if len(why) > LONGEST_REASON or not why.isprintable():
        raise CommandError(ResultCode.BAD_ARGUMENTS, "reason_too_long", most=LONGEST_REASON)
    return why.strip()
