"""Carries out select, cancel, lock, unlock, accept, baseline: the gateway's own verbs. Nothing is written."""

from __future__ import annotations

import secrets
from collections.abc import Callable, Coroutine, Mapping, Sequence
from dataclasses import replace
from typing import Any

from gateway.contract import (
    ACCEPT,
    BASELINE,
    CANCEL,
    LOCK,
    SELECT,
    STOP,
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
from gateway.starters.commands.admission import Admission
from gateway.starters.commands.lifecycle import CommandReport, Final
from gateway.starters.identity.registry import IdentityMismatch
from gateway.starters.policy.policy import GATEWAY, Policy
from gateway.starters.policy.preconditions import NOTICE, owner_of, reason_in, refusal
from gateway.starters.policy.selection import VALID_S, Selection
from gateway.starters.view import StarterControlView
from gateway.system.clock import Clock

SAVED_WITHIN_S = 2.0

# Of a starter, the start of this id (None: the last good one) becomes the baseline, for this client; returns
# the start, or raises CommandError.
SetBaseline = Callable[[str, str | None, str], Mapping[str, Any]]


def no_history(_starter: str, _start: str | None, _client: str) -> Mapping[str, Any]:
    """Refuse: no starts are recorded here."""
    raise CommandError(ResultCode.NO_START, "none")


class LocalVerbs:
    """Locks, unlocks and selects; a lock holds at once, before it is stored."""

    def __init__(
        self,
        admission: Admission,
        policy: Policy,
        *,
        clock: Clock,
        set_baseline: SetBaseline = no_history,
    ) -> None:
        self._admission = admission
        self._motor_history = policy.motor_history
        self._selections = policy.selections
        self._identities = policy.identities
        self._document = policy.document
        self._clock = clock
        self._set_baseline = set_baseline

    def check(self, request: CommandRequest, starter: StarterControlView) -> None:
        """Raise CommandError for a command that must not be."""
        self._admission.check_journal()
        lock = self._motor_history.lock_of(request.starter)
        if request.verb == SELECT:
            self._check_select(request, starter)
        elif request.verb == CANCEL:
            _require_names(request.args, ())
            self._selections.check_own(request.starter, request.client, now_s=self._clock.now_s())
        elif request.verb == ACCEPT:
            _require_names(request.args, ())
            self._identities.waiting(request.starter)
        elif request.verb == BASELINE:
            _chosen_start(request)
        elif request.verb == LOCK:
            reason_in(request.args, request.reason)
            if lock is not None and lock.by != request.client:
                raise refusal(lock)
        else:
            _require_names(request.args, ("reason",))
            if lock is None:
                raise CommandError(ResultCode.NOT_LOCKED)

    def act(self, report: CommandReport, starter: StarterControlView) -> Coroutine[Any, Any, None] | None:
        """Do what was checked, at once; what is returned must be run, and ends the command."""
        request, name = report.request, report.request.starter
        if request.verb == SELECT:
            report.finish(self._select(request, starter))
            return None
        if request.verb == CANCEL:
            self._selections.end(name)
            report.finish(Final(Phase.CONFIRMED, Reason(ResultCode.OK, "cancelled")))
            return None
        if request.verb == BASELINE:
            report.finish(self._baseline(request))
            return None
        if request.verb == ACCEPT:
            return self._accepted(report, self._identities.accept(name))
        before = self._motor_history.lock_of(name)
        if before is not None:
            report.before = {"lock": _lock_data(before)}
        if request.verb == LOCK:
            reason = reason_in(request.args, request.reason)
            self._set_lock(
                starter,
                LockRecord(
                    by=request.client, since_s=self._clock.utc_s(), reason=reason, operator=request.operator
                ),
            )
        else:
            self._set_lock(starter, None)
        return self._keep(report, starter, before)

    async def _keep(
        self, report: CommandReport, starter: StarterControlView, before: LockRecord | None
    ) -> None:
        """Give the result once it is on the disk; an unlocking that cannot be stored is undone."""
        request, is_lock = report.request, report.request.verb == LOCK
        if await self._document.saved(within_s=SAVED_WITHIN_S):
            notes = [NOTICE] if is_lock else []
            why = request.args.get("reason", request.reason)
            owner = None if is_lock or before is None or before.by == request.client else before
            if owner is not None:
                notes = [Note("lock_was", owner=owner_of(owner), reason=owner.reason)]
            self._publish_lock(request, starter, owner, is_lock=is_lock)
            done = Reason(ResultCode.OK, "locked") if is_lock else Reason(ResultCode.OK, "unlocked")
            report.finish(Final(Phase.CONFIRMED, done.noted(*notes)))
            if owner is not None and owner.by != GATEWAY:
                removed = _removal(request, why, owner)
                report.inform(owner.by, Final(Phase.CONFIRMED, removed, values={"by": request.client}))
        elif is_lock:
            report.finish(Final(Phase.FAILED, Reason(ResultCode.NOT_KEPT, "lock")))
        else:
            self._set_lock(starter, before)
            report.finish(Final(Phase.FAILED, Reason(ResultCode.NOT_KEPT, "unlock")))

    def _publish_lock(
        self,
        request: CommandRequest,
        starter: StarterControlView,
        owner: LockRecord | None,
        *,
        is_lock: bool,
    ) -> None:
        """Publish that a starter was locked or unlocked; `owner` is the other client whose lock it was."""
        emitter, client, operator = starter.emitter, request.client, request.operator
        reason = request.args.get("reason", request.reason)
        if is_lock:
            emitter.event(EventCode.LOCKED, client=client, operator=operator, reason=reason)
            return
        if owner is None:
            emitter.event(
                EventCode.UNLOCKED,
                "own",
                severity=Severity.INFO,
                client=client,
                operator=operator,
                reason=reason,
            )
            return
        emitter.event(
            EventCode.UNLOCKED,
            "other",
            severity=Severity.WARNING,
            client=client,
            operator=operator,
            reason=reason,
            lock=_lock_data(owner),
            owner=owner_of(owner),
            owner_reason=owner.reason,
        )

    def _baseline(self, request: CommandRequest) -> Final:
        """Have later starts compared with the chosen one."""
        try:
            start = self._set_baseline(request.starter, _chosen_start(request), request.client)
        except CommandError as error:
            return Final(Phase.REJECTED, error.reason)
        reason = Reason(ResultCode.OK, "baseline", time=start["time"])
        return Final(Phase.CONFIRMED, reason, {"start": start["id"]}, {"start": start})

    async def _accepted(self, report: CommandReport, mismatch: IdentityMismatch) -> None:
        """Give the result of an acceptance once it is on the disk."""
        report.before = mismatch.known.as_data()
        seen = mismatch.seen.as_data()
        if await self._identities.saved():
            end = Final(Phase.CONFIRMED, Reason(ResultCode.OK, "identity"), seen, seen)
        else:
            end = Final(Phase.FAILED, Reason(ResultCode.NOT_KEPT, "identity"), seen, seen)
        report.finish(end)

    def _set_lock(self, starter: StarterControlView, lock: LockRecord | None) -> None:
        self._motor_history.set_lock(starter.setup.name, lock)
        starter.republish_state()
        self._document.touch()

    def _check_select(self, request: CommandRequest, starter: StarterControlView) -> None:
        target = target_of(request)
        if target.verb == STOP or target.verb not in command.verbs(starter.profile):
            raise CommandError(ResultCode.BAD_ARGUMENTS, "not_selectable", verb=target.verb[:40])
        self._admission.check_target(target, starter)
        if _state(starter) == "unknown":
            raise CommandError(ResultCode.STATE_UNKNOWN, "select")
        self._selections.check_free(request.starter, request.client, now_s=self._clock.now_s())

    def _select(self, request: CommandRequest, starter: StarterControlView) -> Final:
        target, state = target_of(request), _state(starter)
        until_s = self._clock.now_s() + VALID_S
        selection = Selection(
            secrets.token_hex(8), target.client, target.verb, args=target.args, state=state, until_s=until_s
        )
        self._selections.set(request.starter, selection)
        values = {"select": selection.token, "valid_s": VALID_S, "state": state}
        reason = Reason(ResultCode.OK, "selected", state=state, verb=target.verb, valid_s=VALID_S)
        return Final(Phase.CONFIRMED, reason, values=values)


def _removal(request: CommandRequest, why: str | None, lock: LockRecord) -> Reason:
    """Return what the owner of a lock reads when another client has removed it."""
    who = f"{request.client} ({request.operator})" if request.operator else request.client
    if not why:
        return Reason(ResultCode.LOCK_REMOVED, "no_reason", who=who, reason=lock.reason)
    return Reason(ResultCode.LOCK_REMOVED, "reason", who=who, why=why, reason=lock.reason)


def _lock_data(lock: LockRecord) -> Mapping[str, Any]:
    return {"by": lock.by, "operator": lock.operator, "reason": lock.reason}


def _chosen_start(request: CommandRequest) -> str | None:
    """Return the id of the start that a baseline names; None: the last good one."""
    _require_names(request.args, ("start",))
    start = request.args.get("start")
    if start is not None and not isinstance(start, str):
        raise CommandError(ResultCode.BAD_ARGUMENTS, "start")
    return start


def target_of(request: CommandRequest) -> CommandRequest:
    """Return the command that a selection is for."""
    _require_names(request.args, ("verb", "args"))
    verb, args = request.args.get("verb"), request.args.get("args", {})
    if not isinstance(verb, str) or not isinstance(args, dict):
        raise CommandError(ResultCode.BAD_ARGUMENTS, "target")
    return replace(request, verb=verb, args=args)


def _state(starter: StarterControlView) -> str:
    return state_of(starter.profile, starter.snapshot.good_values())


def _require_names(args: Mapping[str, Any], names: Sequence[str]) -> None:
    strange = sorted(set(args) - set(names))
    if strange:
        raise CommandError(ResultCode.BAD_ARGUMENTS, "unknown", name=strange[0][:40])
