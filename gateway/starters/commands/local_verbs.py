"""Carries out select, cancel, lock, unlock and accept: the gateway's own verbs. Nothing is written."""

from __future__ import annotations

import secrets
from collections.abc import Callable, Coroutine, Mapping, Sequence
from dataclasses import replace
from typing import Any

from gateway.errors import CommandError
from gateway.families.command.build import verbs
from gateway.families.profile.state import state_of
from gateway.records import ACCEPT, CANCEL, LOCK, SELECT, LockRecord, Phase, Severity
from gateway.starters.commands.admission import Admission
from gateway.starters.commands.lifecycle import STOP, CommandReport, Final
from gateway.starters.commands.view import StarterControlView
from gateway.starters.identity.registry import IdentityMismatch
from gateway.starters.policy.lock import NOTICE, owner_of, reason_in, refusal
from gateway.starters.policy.policy import GATEWAY, Policy
from gateway.starters.policy.request import CommandRequest
from gateway.starters.policy.selection import VALID_S, Selection
from gateway.system.clock import Clock

KEPT_WITHIN_S = 2.0


class LocalVerbs:
    """Locks, unlocks and selects; what is locked is locked at once, before it is kept."""

    def __init__(
        self,
        admission: Admission,
        precautions: Policy,
        *,
        clock: Clock,
        new_token: Callable[[], str] = lambda: secrets.token_hex(8),
    ) -> None:
        self._admission = admission
        self._logbook = precautions.logbook
        self._selections = precautions.selections
        self._identities = precautions.identities
        self._saver = precautions.saver
        self._clock = clock
        self._new_token = new_token

    def check(self, request: CommandRequest, starter: StarterControlView) -> None:
        """Raise CommandError for a command that must not be."""
        self._admission.check_journal()
        lock = self._logbook.lock_of(request.starter)
        if request.verb == SELECT:
            self._check_select(request, starter)
        elif request.verb == CANCEL:
            _require_names(request.args, ())
            self._selections.check_own(request.starter, request.client, now_s=self._clock.now_s())
        elif request.verb == ACCEPT:
            _require_names(request.args, ())
            self._identities.waiting(request.starter)
        elif request.verb == LOCK:
            reason_in(request.args, request.reason)
            if lock is not None and lock.by != request.client:
                raise refusal(lock)
        else:
            _require_names(request.args, ("reason",))
            if lock is None:
                raise CommandError("not_locked", "the starter is not locked")

    def act(self, errand: CommandReport, starter: StarterControlView) -> Coroutine[Any, Any, None] | None:
        """Do what was checked, at once; what is returned must be run, and ends the command."""
        request, name = errand.request, errand.request.starter
        if request.verb == SELECT:
            errand.finish(self._select(request, starter))
            return None
        if request.verb == CANCEL:
            self._selections.end(name)
            errand.finish(Final(Phase.CONFIRMED, "ok", "the selection is cancelled"))
            return None
        if request.verb == ACCEPT:
            return self._accepted(errand, self._identities.accept(name))
        before = self._logbook.lock_of(name)
        if before is not None:
            lock = {"by": before.by, "operator": before.operator, "reason": before.reason}
            errand.before = {"lock": lock}
        if request.verb == LOCK:
            reason = reason_in(request.args, request.reason)
            self._set_lock(starter, LockRecord(request.client, self._clock.utc_s(), reason, request.operator))
        else:
            self._set_lock(starter, None)
        return self._keep(errand, starter, before)

    async def _keep(
        self, errand: CommandReport, starter: StarterControlView, before: LockRecord | None
    ) -> None:
        """Give the result once it is on the disk; an unlocking that cannot be kept is taken back."""
        request, is_lock = errand.request, errand.request.verb == LOCK
        if await self._saver.saved(within_s=KEPT_WITHIN_S):
            code, more = ("locked", f"; {NOTICE}") if is_lock else ("unlocked", "")
            why = request.args.get("reason", request.reason)
            data = {"client": request.client, "operator": request.operator, "reason": why}
            owner = None if is_lock or before is None or before.by == request.client else before
            if owner is not None:
                more = f"; the lock was {owner_of(owner)}'s: {owner.reason}"
                data |= errand.before
            severity = Severity.INFO if owner is None else Severity.WARNING
            starter.publisher.event(code, severity, f"{code} by {request.client}{more}", data)
            errand.finish(Final(Phase.CONFIRMED, "ok", f"{code}{more}"))
            if owner is not None and owner.by != GATEWAY:
                who = f"{request.client} ({request.operator})" if request.operator else request.client
                text = f"your lock was removed by {who}: {why or 'no reason given'}; it was: {owner.reason}"
                errand.inform(
                    owner.by, Final(Phase.CONFIRMED, "lock_removed", text, values={"by": request.client})
                )
        elif is_lock:
            text = "locked as long as this gateway runs, but that could not be kept on the disk"
            errand.finish(Final(Phase.FAILED, "not_kept", text))
        else:
            self._set_lock(starter, before)
            errand.finish(Final(Phase.FAILED, "not_kept", "still locked: it could not be kept on the disk"))

    async def _accepted(self, errand: CommandReport, stranger: IdentityMismatch) -> None:
        """Give the result of an acceptance once it is on the disk."""
        errand.before = stranger.known.as_data()
        seen = stranger.seen.as_data()
        if await self._identities.kept():
            end = Final(Phase.CONFIRMED, "ok", "the present identity is accepted", seen, seen)
        else:
            text = "accepted as long as this gateway runs, but that could not be kept on the disk"
            end = Final(Phase.FAILED, "not_kept", text, seen, seen)
        errand.finish(end)

    def _set_lock(self, starter: StarterControlView, lock: LockRecord | None) -> None:
        self._logbook.set_lock(starter.setup.name, lock)
        starter.restate()
        self._saver.touch()

    def _check_select(self, request: CommandRequest, starter: StarterControlView) -> None:
        target = _target(request)
        if target.verb == STOP or target.verb not in verbs(starter.profile):
            raise CommandError("bad_arguments", f"{target.verb[:40]!r} cannot be selected")
        self._admission.check_target(target, starter)
        if _state(starter) == "unknown":
            raise CommandError("state_unknown", "the starter's state is not known now: nothing to decide by")
        self._selections.check_free(request.starter, request.client, now_s=self._clock.now_s())

    def _select(self, request: CommandRequest, starter: StarterControlView) -> Final:
        target, state = _target(request), _state(starter)
        until_s = self._clock.now_s() + VALID_S
        selection = Selection(
            self._new_token(), target.client, target.verb, args=target.args, state=state, until_s=until_s
        )
        self._selections.set(request.starter, selection)
        values = {"select": selection.token, "valid_s": VALID_S, "state": state}
        text = f"selected while {state}; send {target.verb} with this token within {VALID_S:g} s"
        return Final(Phase.CONFIRMED, "ok", text, values=values)


def _target(request: CommandRequest) -> CommandRequest:
    """Return the command that a selection is for."""
    _require_names(request.args, ("verb", "args"))
    verb, args = request.args.get("verb"), request.args.get("args", {})
    if not isinstance(verb, str) or not isinstance(args, dict):
        raise CommandError("bad_arguments", "name the verb, and its args as an object")
    return replace(request, verb=verb, args=args)


def _state(starter: StarterControlView) -> str:
    return state_of(starter.profile, starter.snapshot.good_values())


def _require_names(args: Mapping[str, Any], names: Sequence[str]) -> None:
    strange = sorted(set(args) - set(names))
    if strange:
        raise CommandError("bad_arguments", f"{strange[0][:40]!r} is unknown")
