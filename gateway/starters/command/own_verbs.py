"""Carries out select, cancel, lock, unlock, accept, baseline: the gateway's own verbs. Nothing is written."""

from __future__ import annotations

from collections.abc import Callable, Coroutine, Mapping
from dataclasses import replace
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
from gateway.starters.view import StarterIo

# Of a starter, the start of this id (None: the last good one) becomes the baseline, for this client; returns
# the start, or raises CommandError.
SetBaseline = Callable[[str, str | None, str], Mapping[str, Any]]


def no_history(_starter: str, _start: str | None, _client: str) -> Mapping[str, Any]:
    """Refuse: no starts are recorded here."""
    raise CommandError(ResultCode.NO_START, "none")


Rest = Coroutine[Any, Any, Final]  # what waits for the disk, and returns the end
Deed = Callable[[CommandReport], Final | Rest]  # does what was asked, at once


class OwnVerbs:
    """Judges and carries out the verbs of its table; a lock holds at once, before it is stored."""

    def __init__(self, admission: Admission, policy: Policy, *, set_baseline: SetBaseline) -> None:
        self._admission = admission
        self._policy = policy
        self._set_baseline = set_baseline
        # By verb: the arguments that there may be, and what judges a command and returns its deed.
        self._verbs: Mapping[str, tuple[set[str], Callable[[CommandRequest, StarterIo], Deed]]] = {
            SELECT: ({"verb", "args"}, self._select),
            CANCEL: (set(), self._cancel),
            LOCK: ({"reason"}, self._lock),
            UNLOCK: ({"reason"}, self._unlock),
            ACCEPT: (set(), self._accept),
            BASELINE: ({"start"}, self._baseline),
        }

    def judge(self, request: CommandRequest, starter: StarterIo) -> Deed:
        """Return what carries a command out; CommandError for one that must not be."""
        arguments, judge = self._verbs[request.verb]
        for strange in sorted(request.args.keys() - arguments):
            raise CommandError(ResultCode.BAD_ARGUMENTS, "unknown", name=strange[:40])
        return judge(request, starter)

    # Two-step commands

    def _select(self, request: CommandRequest, starter: StarterIo) -> Deed:
        target, selections, now_s = target_of(request), self._policy.selections, self._policy.clock.now_s()
        if target.verb == STOP or target.verb not in command.verbs(starter.profile):
            raise CommandError(ResultCode.BAD_ARGUMENTS, "not_selectable", verb=target.verb[:40])
        self._admission.check_target(target, starter)
        state = state_of(starter.profile, starter.snapshot.good_values())
        if state == "unknown":
            raise CommandError(ResultCode.STATE_UNKNOWN, "select")
        earlier = selections.of(request.starter, now_s=now_s)
        if earlier is not None and earlier.client != request.client:
            wait_s = earlier.until_s - now_s
            raise CommandError(ResultCode.SELECTED_BY_OTHER, client=earlier.client, wait_s=wait_s)

        def select(_: CommandReport) -> Final:
            token = selections.select(target, state, now_s=now_s)
            reason = Reason(ResultCode.OK, "selected", state=state, verb=target.verb, valid_s=VALID_S)
            return Final(Phase.CONFIRMED, reason, {"select": token, "valid_s": VALID_S, "state": state})

        return select

    def _cancel(self, request: CommandRequest, _starter: StarterIo) -> Deed:
        selection = self._policy.selections.of(request.starter, now_s=self._policy.clock.now_s())
        if selection is None or selection.client != request.client:
            raise CommandError(ResultCode.NOT_SELECTED, "client", client=request.client)

        def cancel(_: CommandReport) -> Final:
            self._policy.selections.end(request.starter)
            return Final(Phase.CONFIRMED, Reason(ResultCode.OK, "cancelled"))

        return cancel

    # Locks

    def _lock(self, request: CommandRequest, starter: StarterIo) -> Deed:
        reason, before = (
            reason_in(request.args, request.reason),
            self._policy.motor_history.lock_of(request.starter),
        )
        if before is not None and before.by != request.client:
            raise refusal(before)

        def lock(report: CommandReport) -> Rest:
            client, since_s = request.client, self._policy.clock.utc_s()
            new = LockRecord(by=client, since_s=since_s, reason=reason, operator=request.operator)
            self._replace_lock(report, starter, before, new)
            return self._locked(request, starter)

        return lock

    async def _locked(self, request: CommandRequest, starter: StarterIo) -> Final:
        """Return the end of a lock; it holds for this run whether or not it could be stored."""
        if not await self._policy.document.saved():
            return Final(Phase.FAILED, Reason(ResultCode.NOT_KEPT, "lock"))
        who, why = request.operator, _why(request)
        starter.emitter.event(EventCode.LOCKED, client=request.client, operator=who, reason=why)
        return Final(Phase.CONFIRMED, Reason(ResultCode.OK, "locked").noted(NOTICE))

    def _unlock(self, request: CommandRequest, starter: StarterIo) -> Deed:
        before = self._policy.motor_history.lock_of(request.starter)
        if before is None:
            raise CommandError(ResultCode.NOT_LOCKED)

        def unlock(report: CommandReport) -> Rest:
            self._replace_lock(report, starter, before, None)
            return self._unlocked(report, starter, before)

        return unlock

    async def _unlocked(self, report: CommandReport, starter: StarterIo, before: LockRecord) -> Final:
        """Return the end of an unlocking; one that cannot be stored is undone."""
        request = report.request
        if not await self._policy.document.saved():
            self._set_lock(starter, before)
            return Final(Phase.FAILED, Reason(ResultCode.NOT_KEPT, "unlock"))
        end = Final(Phase.CONFIRMED, Reason(ResultCode.OK, "unlocked"))
        client, who, why = request.client, request.operator, _why(request)
        event = starter.emitter.event
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
            lock=_lock_data(before),
            owner=owner,
            owner_reason=before.reason,
        )
        if before.by != GATEWAY:
            report.inform(before.by, Final(Phase.CONFIRMED, _removal(request, before), {"by": client}))
        return end.noted(Note("lock_was", owner=owner, reason=before.reason))

    def _replace_lock(
        self, report: CommandReport, starter: StarterIo, before: LockRecord | None, new: LockRecord | None
    ) -> None:
        report.before = {} if before is None else {"lock": _lock_data(before)}
        self._set_lock(starter, new)

    def _set_lock(self, starter: StarterIo, lock: LockRecord | None) -> None:
        self._policy.motor_history.set_lock(starter.setup.name, lock)
        starter.republish_state()

    # What is compared with later devices and later starts

    def _accept(self, request: CommandRequest, _starter: StarterIo) -> Deed:
        self._policy.identities.waiting(request.starter)

        def accept(report: CommandReport) -> Rest:
            mismatch = self._policy.identities.accept(request.starter)
            report.before = mismatch.known.as_data()
            return self._accepted(mismatch.seen.as_data())

        return accept

    async def _accepted(self, seen: Mapping[str, Any]) -> Final:
        """Return the end of an acceptance."""
        if await self._policy.identities.saved():
            return Final(Phase.CONFIRMED, Reason(ResultCode.OK, "identity"), seen, seen)
        return Final(Phase.FAILED, Reason(ResultCode.NOT_KEPT, "identity"), seen, seen)

    def _baseline(self, request: CommandRequest, _starter: StarterIo) -> Deed:
        start_id = request.args.get("start")
        if not isinstance(start_id, str | None):
            raise CommandError(ResultCode.BAD_ARGUMENTS, "start")

        def set_baseline(_: CommandReport) -> Final:
            """Have later starts compared with the chosen one; None is the last good one."""
            try:
                start = self._set_baseline(request.starter, start_id, request.client)
            except CommandError as error:
                return Final(Phase.REJECTED, error.reason)
            reason = Reason(ResultCode.OK, "baseline", time=start["time"])
            return Final(Phase.CONFIRMED, reason, {"start": start["id"]}, {"start": start})

        return set_baseline


def _why(request: CommandRequest) -> str | None:
    why: str | None = request.args.get("reason", request.reason)
    return why


def _removal(request: CommandRequest, lock: LockRecord) -> Reason:
    """Return what the owner of a lock reads when another client has removed it."""
    who = f"{request.client} ({request.operator})" if request.operator else request.client
    why = _why(request)
    if not why:
        return Reason(ResultCode.LOCK_REMOVED, "no_reason", who=who, reason=lock.reason)
    return Reason(ResultCode.LOCK_REMOVED, "reason", who=who, why=why, reason=lock.reason)


def _lock_data(lock: LockRecord) -> Mapping[str, Any]:
    return {"by": lock.by, "operator": lock.operator, "reason": lock.reason}


def target_of(request: CommandRequest) -> CommandRequest:
    """Return the command that a selection is for."""
    verb, args = request.args.get("verb"), request.args.get("args", {})
    if not isinstance(verb, str) or not isinstance(args, dict):
        raise CommandError(ResultCode.BAD_ARGUMENTS, "target")
    return replace(request, verb=verb, args=args)
