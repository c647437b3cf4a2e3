"""Carries out select, cancel, lock, unlock, accept, baseline: the gateway's own verbs. Nothing is written.

Each verb is one function. Up to its first `yield` it judges, and raises CommandError for a command that must
not be; the `yield` returns the report of the accepted command, which is then carried out at once. A second
`yield` waits for the disk, and returns whether that has stored what was done.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Generator, Mapping
from dataclasses import dataclass, replace
from typing import Any

from gateway.contract import (
    ACCEPT,
    BASELINE,
    CANCEL,
    LOCK,
    SELECT,
    STOP,
    UNLOCK,
    CommandError,
    CommandRequest,
    EventCode,
    LockRecord,
    Note,
    Phase,
    Reason,
    ResultCode,
    Severity,
)
from gateway.families import command, state_of
from gateway.starters.command.admission import Admission
from gateway.starters.command.report import CommandReport, Final
from gateway.starters.policy.policy import GATEWAY, Policy
from gateway.starters.policy.preconditions import NOTICE, owner_of, reason_in, refusal
from gateway.starters.policy.selection import VALID_S
from gateway.starters.starter import StarterTelemetry

# Of a starter, the start of this id (None: the last good one) becomes the baseline, for this client; returns
# the start, or raises CommandError.
SetBaseline = Callable[[str, str | None, str], Mapping[str, Any]]

Deed = Generator[Awaitable[bool] | None, Any, Final]


@dataclass
class OwnVerbs:
    """Judges and carries out the verbs of its table; a lock holds at once, before it is stored."""

    admission: Admission
    policy: Policy
    set_baseline: SetBaseline

    def __post_init__(self) -> None:
        self._verbs: Mapping[str, tuple[set[str], Callable[[CommandRequest, StarterTelemetry], Deed]]] = {
            SELECT: ({"verb", "args"}, self._select),  # with the arguments that there may be
            CANCEL: (set(), self._cancel),
            LOCK: ({"reason"}, self._lock),
            UNLOCK: ({"reason"}, self._unlock),
            ACCEPT: (set(), self._accept),
            BASELINE: ({"start"}, self._baseline),
        }

    def judge(self, request: CommandRequest, starter: StarterTelemetry) -> Deed:
        """Return what carries a command out, begun and judged; CommandError for one that must not be."""
        arguments, verb = self._verbs[request.verb]
        for strange in sorted(request.args.keys() - arguments):
            raise CommandError(ResultCode.BAD_ARGUMENTS, "unknown", name=strange[:40])
        deed = verb(request, starter)
        next(deed)
        return deed

    # Two-step commands

    def _select(self, request: CommandRequest, starter: StarterTelemetry) -> Deed:
        target, selections, now_s = target_of(request), self.policy.selections, self.policy.clock.now_s()
        if target.verb == STOP or target.verb not in command.verbs(starter.profile):
            raise CommandError(ResultCode.BAD_ARGUMENTS, "not_selectable", verb=target.verb[:40])
        self.admission.check_target(target, starter)
        state = state_of(starter.profile, starter.snapshot.good_values())
        if state == "unknown":
            raise CommandError(ResultCode.STATE_UNKNOWN, "select")
        earlier = selections.of(request.starter, now_s=now_s)
        if earlier is not None and earlier.target.client != request.client:
            wait_s = earlier.until_s - now_s
            raise CommandError(ResultCode.SELECTED_BY_OTHER, client=earlier.target.client, wait_s=wait_s)
        yield None
        token = selections.select(target, state, now_s=now_s)
        reason = Reason(ResultCode.OK, "selected", state=state, verb=target.verb, valid_s=VALID_S)
        return Final(Phase.CONFIRMED, reason, {"select": token, "valid_s": VALID_S, "state": state})

    def _cancel(self, request: CommandRequest, _starter: StarterTelemetry) -> Deed:
        selection = self.policy.selections.of(request.starter, now_s=self.policy.clock.now_s())
        if selection is None or selection.target.client != request.client:
            raise CommandError(ResultCode.NOT_SELECTED, "client", client=request.client)
        yield None
        self.policy.selections.end(request.starter)
        return Final(Phase.CONFIRMED, Reason(ResultCode.OK, "cancelled"))

    # Locks

    def _lock(self, request: CommandRequest, starter: StarterTelemetry) -> Deed:
        """Lock a starter for this run, whether or not the lock can be stored."""
        reason = reason_in(request.args, request.reason)
        before = self.policy.motor_history.lock_of(request.starter)
        if before is not None and before.by != request.client:
            raise refusal(before)
        report: CommandReport = yield None
        report.before = _lock_data(before)
        client, who, since_s = request.client, request.operator, self.policy.clock.utc_s()
        self._set_lock(starter, LockRecord(by=client, since_s=since_s, reason=reason, operator=who))
        if not (yield self.policy.document.saved()):
            return Final(Phase.FAILED, Reason(ResultCode.NOT_KEPT, "lock"))
        starter.event(EventCode.LOCKED, client=client, operator=who, reason=_why(request))
        return Final(Phase.CONFIRMED, Reason(ResultCode.OK, "locked").noted(NOTICE))

    def _unlock(self, request: CommandRequest, starter: StarterTelemetry) -> Deed:
        """Unlock a starter; an unlocking that cannot be stored is undone."""
        before = self.policy.motor_history.lock_of(request.starter)
        if before is None:
            raise CommandError(ResultCode.NOT_LOCKED)
        report: CommandReport = yield None
        report.before = _lock_data(before)
        self._set_lock(starter, None)
        if not (yield self.policy.document.saved()):
            self._set_lock(starter, before)
            return Final(Phase.FAILED, Reason(ResultCode.NOT_KEPT, "unlock"))
        end, event = Final(Phase.CONFIRMED, Reason(ResultCode.OK, "unlocked")), starter.event
        client, who, why = request.client, request.operator, _why(request)
        if before.by == client:
            event(EventCode.UNLOCKED, "own", severity=Severity.INFO, client=client, operator=who, reason=why)
            return end
        owner = owner_of(before)
        event(
            EventCode.UNLOCKED,
            "other",
            severity=Severity.WARNING,
            client=client,
            operator=who,
            reason=why,
            lock=report.before["lock"],
            owner=owner,
            owner_reason=before.reason,
        )
        if before.by != GATEWAY:
            report.inform(before.by, Final(Phase.CONFIRMED, _removal(request, before), {"by": client}))
        return end.noted(Note("lock_was", owner=owner, reason=before.reason))

    def _set_lock(self, starter: StarterTelemetry, lock: LockRecord | None) -> None:
        self.policy.motor_history.set_lock(starter.setup.name, lock)
        starter.republish_state()

    # What is compared with later devices and later starts

    def _accept(self, _request: CommandRequest, starter: StarterTelemetry) -> Deed:
        """Take the present device for the right one, for this run whether or not that can be stored."""
        starter.contact.waiting()
        report: CommandReport = yield None
        mismatch = starter.contact.accept()
        report.before, seen = mismatch.known.as_data(), mismatch.seen.as_data()
        if not (yield self.policy.identities.saved()):
            return Final(Phase.FAILED, Reason(ResultCode.NOT_KEPT, "identity"), seen, seen)
        return Final(Phase.CONFIRMED, Reason(ResultCode.OK, "identity"), seen, seen)

    def _baseline(self, request: CommandRequest, _starter: StarterTelemetry) -> Deed:
        """Have later starts compared with the chosen one; None is the last good one."""
        start_id = request.args.get("start")
        if not isinstance(start_id, str | None):
            raise CommandError(ResultCode.BAD_ARGUMENTS, "start")
        yield None
        try:
            start = self.set_baseline(request.starter, start_id, request.client)
        except CommandError as error:
            return Final(Phase.REJECTED, error.reason)
        reason = Reason(ResultCode.OK, "baseline", time=start["time"])
        return Final(Phase.CONFIRMED, reason, {"start": start["id"]}, {"start": start})


def _why(request: CommandRequest) -> str | None:
    why: str | None = request.args.get("reason", request.reason)
    return why


def _removal(request: CommandRequest, lock: LockRecord) -> Reason:
    """Return what the owner of a lock reads when another client has removed it."""
    who = f"{request.client} ({request.operator})" if request.operator else request.client
    why = _why(request) or "no reason was given"
    return Reason(ResultCode.LOCK_REMOVED, who=who, why=why, reason=lock.reason)


def _lock_data(lock: LockRecord | None) -> Mapping[str, Any]:
    return {"lock": {"by": lock.by, "operator": lock.operator, "reason": lock.reason}} if lock else {}


def target_of(request: CommandRequest) -> CommandRequest:
    """Return the command that a selection is for."""
    verb, args = request.args.get("verb"), request.args.get("args", {})
    if not isinstance(verb, str) or not isinstance(args, dict):
        raise CommandError(ResultCode.BAD_ARGUMENTS, "target")
    return replace(request, verb=verb, args=args)
