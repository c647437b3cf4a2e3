"""Judges commands as they come in, without reading anything."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from gateway.contract import CANCEL, OWN_VERBS, READ, SELECT, STOP, CommandError, CommandRequest, ResultCode
from gateway.families import Preparation, command, reading
from gateway.starters.command.report import Reporting
from gateway.starters.command.run.decision import judge, rows_for
from gateway.starters.identity import IdentityStatus, not_matching
from gateway.starters.policy.policy import Policy
from gateway.starters.policy.preconditions import STATE, Expectation, Guard, demand_unlocked
from gateway.starters.policy.rights import Rights
from gateway.starters.view import StarterIo

Check = Callable[[str], None]  # of a starter


class Admission:
    """Every method that checks raises CommandError for a command that must not be."""

    def __init__(
        self, starters: Mapping[str, StarterIo], rights: Rights, *, policy: Policy, reporting: Reporting
    ) -> None:
        self.rights = rights
        self._starters = starters
        self._policy = policy
        self._reporting = reporting

    def check_sender(self, request: CommandRequest) -> None:
        """Demand a starter or group, a verb that it has, this client's right to it, and an id."""
        if request.starter in self._policy.settings.groups:
            self._check_group_sender(request)
            return
        if request.starter not in self._starters:
            raise CommandError(ResultCode.UNKNOWN_STARTER)
        self.check_verb(request.starter, request.verb)
        if not self._may(request):
            raise self.no_right(request)
        if not request.id and request.verb != STOP:
            raise CommandError(ResultCode.NO_ID)

    def check_verb(self, name: str, verb: str) -> None:
        """Demand a verb of this starter's family or of the gateway; one that is not configured has any."""
        starter = self._starters.get(name)
        if starter is not None and verb not in (*command.verbs(starter.profile), *OWN_VERBS):
            title = starter.profile.title
            raise CommandError(ResultCode.UNKNOWN_VERB, "starter", title=title, verb=verb[:40])

    def may_stop(self, client: str, starter: str) -> bool:
        """Return whether a client may stop a starter."""
        return self.rights.is_allowed(client, verb=STOP, starter=starter)

    def no_right(self, request: CommandRequest) -> CommandError:
        """Return the refusal of a command to which its client has no right."""
        client, verb, starter = request.client, request.verb, request.starter
        return CommandError(ResultCode.NOT_ALLOWED, "starter", client=client, verb=verb, starter=starter)

    def check_journal(self) -> None:
        """Demand a ledger that can be written and has room."""
        trouble, ledger = self._reporting.journal.trouble, self._reporting.ledger
        if trouble:
            raise CommandError(ResultCode.LEDGER_UNAVAILABLE, "trouble", trouble=trouble)
        if not ledger.has_room(self._reporting.now_s()):
            raise CommandError(ResultCode.LEDGER_FULL, count=len(ledger))

    def check(
        self, request: CommandRequest, starter: StarterIo, check_free: Check
    ) -> tuple[Preparation, Guard]:
        """Return what to read before the command, and what watches over it."""
        preparation = self.check_target(request, starter)
        check_free(request.starter)
        expectations = [Expectation(starter.profile, request.expect), *self._selected(request, starter)]
        guard = self._policy.guard(request, expectations)
        reads = reading.with_rows(starter.profile, preparation.reads, guard.codes)
        return replace(preparation, reads=reads), guard

    def preview(self, request: CommandRequest, starter: StarterIo, check_free: Check) -> None:
        """Judge a command, as if it were selected, by what was read last; nothing is counted or used up."""
        preparation = self.check_target(request, starter)
        check_free(request.starter)
        rows = rows_for(preparation, starter.snapshot.rows)
        guard, points = self._policy.guard(request, ()), starter.snapshot.good_values()
        judge(request, starter, preparation, guard, rows=rows, points=points)

    def check_target(self, request: CommandRequest, starter: StarterIo) -> Preparation:
        """Demand that a command makes sense for a starter that answers, is known and not locked."""
        self.check_journal()
        is_local = starter.snapshot.good_values().get("remote") is False
        preparation = command.prepare(
            starter.profile, starter.variant, request.verb, request.args, is_local=is_local
        )
        demand_unlocked(request, self._policy.motor_history)
        if not starter.is_answering:
            raise CommandError(ResultCode.OFFLINE, "starter")
        standing = starter.identity_standing
        if request.verb == READ and (starter.contradiction or standing is IdentityStatus.OTHER_SLOT):
            return preparation  # of one that contradicts the configuration its raw words are all that is said
        if standing is not IdentityStatus.MATCHING:
            raise not_matching(standing, starter.identity_reason)
        return preparation

    def _selected(self, request: CommandRequest, starter: StarterIo) -> tuple[Expectation, ...]:
        """Use up the selection of a command in two steps; return that the state must be the one seen then."""
        if request.select is None:
            if request.verb in self._policy.rulebook.of(request.starter).two_step:
                raise CommandError(ResultCode.SELECT_FIRST, verb=request.verb)
            return ()
        selection = self._policy.selections.take(request, now_s=self._reporting.now_s())
        return (Expectation(starter.profile, {STATE: selection.state}, code=ResultCode.STATE_CHANGED),)

    def _check_group_sender(self, request: CommandRequest) -> None:
        if request.verb != STOP:
            raise CommandError(ResultCode.GROUP_ONLY_STOP, group=request.starter)
        members = self._policy.settings.groups[request.starter]
        if not any(self.may_stop(request.client, member) for member in members):
            raise CommandError(ResultCode.NOT_ALLOWED, "group", client=request.client, group=request.starter)

    def _may(self, request: CommandRequest) -> bool:
        """Return whether the client has the right; who may do something may also select it, and cancel."""
        verb, client, starter = request.verb, request.client, request.starter
        if verb == CANCEL:
            return self.rights.has_any(client, starter=starter)
        if verb == SELECT:
            verb = str(request.args.get("verb"))
        return self.rights.is_allowed(client, verb=verb, starter=starter)
