"""Carries out select, cancel, lock, unlock, accept, baseline: the gateway's own verbs. Nothing is written."""

from __future__ import annotations

import secrets
from collections.abc import Callable, Coroutine, Mapping
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
from gateway.starters.policy.selection import VALID_S, Selection
from gateway.starters.view import StarterIo
from gateway.system.clock import Clock

SAVED_WITHIN_S = 2.0

# Of a starter, the start of this id (None: the last good one) becomes the baseline, for this client; returns
# the start, or raises CommandError.
SetBaseline = Callable[[str, str | None, str], Mapping[str, Any]]


def no_history(_starter: str, _start: str | None, _client: str) -> Mapping[str, Any]:
    """Refuse: no starts are recorded here."""
    raise CommandError(ResultCode.NO_START, "none")


Work = Coroutine[Any, Any, None]  # what must be run, and ends the command
Rest = Coroutine[Any, Any, Final]  # what waits for the disk, and returns the end


class OwnVerbs:
    """Carries out the verbs of the table below; a lock holds at once, before it is stored."""

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
        self._verbs: Mapping[str, _OwnVerb] = {
            SELECT: _OwnVerb({"verb", "args"}, self._check_select, self._select),
            CANCEL: _OwnVerb(set(), self._check_cancel, self._cancel),
            LOCK: _OwnVerb({"reason"}, self._check_lock, self._lock),
            UNLOCK: _OwnVerb({"reason"}, self._check_unlock, self._unlock),
            ACCEPT: _OwnVerb(set(), self._check_accept, self._accept),
            BASELINE: _OwnVerb({"start"}, self._check_baseline, self._baseline),
        }

    def check(self, request: CommandRequest, starter: StarterIo) -> None:
        """Raise CommandError for a command that must not be."""
        self._admission.check_journal()
        verb = self._verbs[request.verb]
        for strange in sorted(set(request.args) - verb.arguments):
            raise CommandError(ResultCode.BAD_ARGUMENTS, "unknown", name=strange[:40])
        verb.check(request, starter)

    def act(self, report: CommandReport, starter: StarterIo) -> Work | None:
        """Do what was checked, at once; what is returned must be run, and ends the command."""
        end = self._verbs[report.request.verb].act(report, starter)
        if not isinstance(end, Final):
            return self._finished(report, end)
        report.finish(end)
        return None

    async def _finished(self, report: CommandReport, rest: Rest) -> None:
        report.finish(await rest)

    # Two-step commands

    def _check_select(self, request: CommandRequest, starter: StarterIo) -> None:
        target = target_of(request)
        if target.verb == STOP or target.verb not in command.verbs(starter.profile):
            raise CommandError(ResultCode.BAD_ARGUMENTS, "not_selectable", verb=target.verb[:40])
        self._admission.check_target(target, starter)
        if _state(starter) == "unknown":
            raise CommandError(ResultCode.STATE_UNKNOWN, "select")
        self._selections.check_free(request.starter, request.client, now_s=self._clock.now_s())

    def _select(self, report: CommandReport, starter: StarterIo) -> Final:
        target, state = target_of(report.request), _state(starter)
        until_s = self._clock.now_s() + VALID_S
        selection = Selection(
            secrets.token_hex(8), target.client, target.verb, args=target.args, state=state, until_s=until_s
        )
        self._selections.set(report.request.starter, selection)
        values = {"select": selection.token, "valid_s": VALID_S, "state": state}
        reason = Reason(ResultCode.OK, "selected", state=state, verb=target.verb, valid_s=VALID_S)
        return Final(Phase.CONFIRMED, reason, values)

    def _check_cancel(self, request: CommandRequest, _starter: StarterIo) -> None:
        self._selections.check_own(request.starter, request.client, now_s=self._clock.now_s())

    def _cancel(self, report: CommandReport, _starter: StarterIo) -> Final:
        self._selections.end(report.request.starter)
        return Final(Phase.CONFIRMED, Reason(ResultCode.OK, "cancelled"))

    # Locks

    def _check_lock(self, request: CommandRequest, _starter: StarterIo) -> None:
        reason_in(request.args, request.reason)
        lock = self._motor_history.lock_of(request.starter)
        if lock is not None and lock.by != request.client:
            raise refusal(lock)

    def _lock(self, report: CommandReport, starter: StarterIo) -> Rest:
        request = report.request
        lock = LockRecord(
            by=request.client,
            since_s=self._clock.utc_s(),
            reason=reason_in(request.args, request.reason),
            operator=request.operator,
        )
        self._replace_lock(report, starter, lock)
        return self._locked(request, starter)

    async def _locked(self, request: CommandRequest, starter: StarterIo) -> Final:
        """Return the end of a lock; it holds for this run whether or not it could be stored."""
        if not await self._document.saved(within_s=SAVED_WITHIN_S):
            return Final(Phase.FAILED, Reason(ResultCode.NOT_KEPT, "lock"))
        who, why = request.operator, _why(request)
        starter.emitter.event(EventCode.LOCKED, client=request.client, operator=who, reason=why)
        return Final(Phase.CONFIRMED, Reason(ResultCode.OK, "locked").noted(NOTICE))

    def _check_unlock(self, request: CommandRequest, _starter: StarterIo) -> None:
        if self._motor_history.lock_of(request.starter) is None:
            raise CommandError(ResultCode.NOT_LOCKED)

    def _unlock(self, report: CommandReport, starter: StarterIo) -> Rest:
        before = self._replace_lock(report, starter, None)
        return self._unlocked(report, starter, before)

    async def _unlocked(self, report: CommandReport, starter: StarterIo, before: LockRecord | None) -> Final:
        """Return the end of an unlocking; one that cannot be stored is undone."""
        request = report.request
        if not await self._document.saved(within_s=SAVED_WITHIN_S):
            self._set_lock(starter, before)
            return Final(Phase.FAILED, Reason(ResultCode.NOT_KEPT, "unlock"))
        end = Final(Phase.CONFIRMED, Reason(ResultCode.OK, "unlocked"))
        client, who, why = request.client, request.operator, _why(request)
        event = starter.emitter.event
        if before is None or before.by == client:
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
            removed = Final(Phase.CONFIRMED, _removal(request, before), {"by": request.client})
            report.inform(before.by, removed)
        return end.noted(Note("lock_was", owner=owner, reason=before.reason))

    def _replace_lock(
        self, report: CommandReport, starter: StarterIo, lock: LockRecord | None
    ) -> LockRecord | None:
        """Set or take away a lock, and return the one that there was."""
        before = self._motor_history.lock_of(report.request.starter)
        if before is not None:
            report.before = {"lock": _lock_data(before)}
        self._set_lock(starter, lock)
        return before

    def _set_lock(self, starter: StarterIo, lock: LockRecord | None) -> None:
        self._motor_history.set_lock(starter.setup.name, lock)
        starter.republish_state()

    # What is compared with later devices and later starts

    def _check_accept(self, request: CommandRequest, _starter: StarterIo) -> None:
        self._identities.waiting(request.starter)

    def _accept(self, report: CommandReport, _starter: StarterIo) -> Rest:
        mismatch = self._identities.accept(report.request.starter)
        report.before = mismatch.known.as_data()
        return self._accepted(mismatch.seen.as_data())

    async def _accepted(self, seen: Mapping[str, Any]) -> Final:
        """Return the end of an acceptance."""
        if await self._identities.saved():
            return Final(Phase.CONFIRMED, Reason(ResultCode.OK, "identity"), seen, seen)
        return Final(Phase.FAILED, Reason(ResultCode.NOT_KEPT, "identity"), seen, seen)

    def _check_baseline(self, request: CommandRequest, _starter: StarterIo) -> None:
        if not isinstance(request.args.get("start"), str | None):
            raise CommandError(ResultCode.BAD_ARGUMENTS, "start")

    def _baseline(self, report: CommandReport, _starter: StarterIo) -> Final:
        """Have later starts compared with the chosen one; None is the last good one."""
        request = report.request
        try:
            start = self._set_baseline(request.starter, request.args.get("start"), request.client)
        except CommandError as error:
            return Final(Phase.REJECTED, error.reason)
        reason = Reason(ResultCode.OK, "baseline", time=start["time"])
        return Final(Phase.CONFIRMED, reason, {"start": start["id"]}, {"start": start})


@dataclass(frozen=True, slots=True)
class _OwnVerb:
    """One row of the table: the arguments that there may be, what must hold, and what is done."""

    arguments: set[str]
    check: Callable[[CommandRequest, StarterIo], None]
    act: Callable[[CommandReport, StarterIo], Final | Rest]


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


def _state(starter: StarterIo) -> str:
    return state_of(starter.profile, starter.snapshot.good_values())
