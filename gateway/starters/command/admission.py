"""Judges commands as they come in, without reading anything, and answers those that are too many."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import dataclass, replace

from gateway.contract import (
    CANCEL,
    OWN_VERBS,
    READ,
    SELECT,
    STOP,
    CommandError,
    CommandRequest,
    Note,
    Phase,
    Reason,
    ResultCode,
)
from gateway.families import Preparation, command, diagnosis, reading
from gateway.starters.command.report import CommandReport, Final, Reporting
from gateway.starters.command.run.pipeline import CAN_WAIT
from gateway.starters.identity import IdentityStatus, not_matching
from gateway.starters.policy.policy import Policy
from gateway.starters.policy.preconditions import STATE, Expectation, Guard, is_forbidden, refusal
from gateway.starters.policy.rights import Rights
from gateway.starters.view import StarterIo
from gateway.system.rate_limits import REFUSAL_EVERY_S, Damped


@dataclass(frozen=True, slots=True)
class Load:
    """What is under way when a command comes in."""

    is_busy: bool  # its starter
    is_leaving: bool  # its starter's configuration is about to change
    on_line: int  # commands for starters of its line
    parameters_on_line: int  # those of them that move no motor


class Admission:
    """Every method raises CommandError for a command that must not be."""

    def __init__(
        self, starters: Mapping[str, StarterIo], rights: Rights, *, policy: Policy, reporting: Reporting
    ) -> None:
        self._starters = starters
        self._rights = rights
        self._policy = policy
        self._reporting = reporting

    def apply_rights(self, rights: Rights) -> None:
        """Judge by these rights from now on."""
        self._rights = rights

    def check_sender(self, request: CommandRequest) -> None:
        """Demand a starter or group, a verb that it has, this client's right to it, and an id."""
        if request.starter in self._policy.settings.groups:
            self._check_group_sender(request)
            return
        starter = self._starters.get(request.starter)
        if starter is None:
            raise CommandError(ResultCode.UNKNOWN_STARTER)
        self.check_verb(request.starter, request.verb)
        if not self._may(request):
            raise no_right(request)
        if not request.id and request.verb != STOP:
            raise CommandError(ResultCode.NO_ID)

    def check_verb(self, name: str, verb: str) -> None:
        """Demand a verb of this starter's family or of the gateway; one that is not configured has any."""
        starter = self._starters.get(name)
        if starter is not None and verb not in (*command.verbs(starter.profile), *OWN_VERBS):
            raise CommandError(
                ResultCode.UNKNOWN_VERB, "starter", title=starter.profile.title, verb=verb[:40]
            )

    def may_stop(self, client: str, starter: str) -> bool:
        """Return whether a client may stop a starter."""
        return self._rights.is_allowed(client, verb=STOP, starter=starter)

    def check_journal(self) -> None:
        """Demand a ledger that can be written and has room."""
        trouble, ledger = self._reporting.journal.trouble, self._reporting.ledger
        if trouble:
            raise CommandError(ResultCode.LEDGER_UNAVAILABLE, "trouble", trouble=trouble)
        if not ledger.has_room(self._reporting.now_s()):
            raise CommandError(ResultCode.LEDGER_FULL, count=len(ledger))

    def check(self, request: CommandRequest, starter: StarterIo, load: Load) -> tuple[Preparation, Guard]:
        """Return what to read before the command, and what watches over it."""
        preparation = self._check_now(request, starter, load)
        expectations = [Expectation(starter.profile, request.expect), *self._selected(request, starter)]
        guard = self._policy.guard(request, expectations)
        more = guard.codes
        if request.verb != READ:
            more += diagnosis.distinctive_rows(starter.profile)
        reads = reading.with_rows(starter.profile, preparation.reads, more)
        return replace(preparation, reads=reads), guard

    def preview(self, request: CommandRequest, starter: StarterIo, load: Load) -> None:
        """Judge a command, as if it were selected, by what was read last; nothing is counted or used up."""
        preparation = self._check_now(request, starter, load)
        points = starter.snapshot.good_values()
        known = {**starter.snapshot.rows, **points}
        command.demand(starter.profile, preparation.requires, known, variant=starter.variant)
        self._policy.guard(request, ()).check(points)
        rows = starter.snapshot.rows
        if all(code in rows for read in preparation.reads for code in read.codes):
            command.build(starter.profile, starter.variant, request.verb, request.args, seen=rows)

    def _check_now(self, request: CommandRequest, starter: StarterIo, load: Load) -> Preparation:
        """Demand what can be judged without reading, whether or not the command was selected."""
        preparation = self.check_target(request, starter)
        if load.is_busy:
            raise CommandError(ResultCode.BUSY, "command")
        if load.is_leaving:
            raise CommandError(ResultCode.BUSY, "reload")
        self._check_room(request, load)
        return preparation

    def check_target(self, request: CommandRequest, starter: StarterIo) -> Preparation:
        """Demand that a command makes sense for a starter that answers, is known and not locked."""
        self.check_journal()
        is_local = starter.snapshot.good_values().get("remote") is False
        preparation = command.prepare(
            starter.profile, starter.variant, request.verb, request.args, is_local=is_local
        )
        lock = self._policy.motor_history.lock_of(request.starter)
        if lock is not None and is_forbidden(request.verb, request.args):
            raise refusal(lock)
        if not starter.is_answering:
            raise CommandError(ResultCode.OFFLINE, "starter")
        standing = starter.identity_standing
        if request.verb == READ and (starter.contradiction or standing is IdentityStatus.OTHER_SLOT):
            return preparation  # of one that contradicts the configuration its raw words are all that is said
        if standing is not IdentityStatus.MATCHING:
            raise not_matching(standing, starter.identity_reason)
        return preparation

    def _check_room(self, request: CommandRequest, load: Load) -> None:
        """Demand that not too many commands are under way on the line."""
        limits = self._policy.settings.limits
        if load.on_line >= limits.under_way_on_line:
            most = limits.under_way_on_line
            raise CommandError(ResultCode.TOO_MANY, "line", count=load.on_line, most=most)
        if request.verb in CAN_WAIT and load.parameters_on_line >= limits.parameters_on_line:
            raise CommandError(ResultCode.TOO_MANY, "parameters", count=load.parameters_on_line)

    def _selected(self, request: CommandRequest, starter: StarterIo) -> tuple[Expectation, ...]:
        """Use up the selection of a command in two steps; return that the state must be the one seen then."""
        if request.select is None:
            if request.verb in self._policy.rulebook.of(request.starter).two_step:
                raise CommandError(ResultCode.SELECT_FIRST, verb=request.verb)
            return ()
        selection = self._policy.selections.take(
            request.starter,
            request.client,
            request.select,
            verb=request.verb,
            args=request.args,
            now_s=self._reporting.now_s(),
        )
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
            return self._rights.has_any(client, starter=starter)
        if verb == SELECT:
            verb = str(request.args.get("verb"))
        return self._rights.is_allowed(client, verb=verb, starter=starter)


def no_right(request: CommandRequest) -> CommandError:
    """Return the refusal of a command to which its client has no right."""
    return CommandError(
        ResultCode.NOT_ALLOWED,
        "starter",
        client=request.client,
        verb=request.verb,
        starter=request.starter,
    )


class OverloadRefusals:
    """Refuses for each client at most ten times a second, and never under an id that has a result."""

    def __init__(self, reporting: Reporting) -> None:
        self._reporting = reporting
        self._refusals = Damped(self._refuse, clock=reporting.records.clock, every_s=REFUSAL_EVERY_S)
        self._stops = Damped(self._answer_stop, clock=reporting.records.clock, every_s=REFUSAL_EVERY_S)

    def refuse(self, client: Hashable, request: CommandRequest) -> None:
        """Refuse a command now, or count it; one whose id is known gets no answer."""
        if self._reporting.ledger.find(request.client, request.id) is None:
            self._refusals.put(client, request)

    def answer_untracked_stop(self, client: Hashable, request: CommandRequest) -> None:
        """Answer a stop whose frame goes out, but which is not followed up to an end of its own."""
        if self._reporting.ledger.find(request.client, request.id) is None:
            self._stops.put(client, request)

    def close(self) -> None:
        """Report now what has only been counted."""
        self._refusals.close()
        self._stops.close()

    def _refuse(self, request: CommandRequest, count: int) -> None:
        reason = Reason(ResultCode.TOO_MANY, "client")
        if count:
            request = replace(request, id=None, correlation=None)
            reason = Reason(ResultCode.TOO_MANY, "client_more", count=count)
        end = Final(Phase.REJECTED, reason, values={"count": count} if count else {})
        CommandReport(request, self._reporting).refuse(end)

    def _answer_stop(self, request: CommandRequest, count: int) -> None:
        """Say what is known of a stop that was sent: rejected would mean that nothing was written."""
        reason = Reason(ResultCode.TOO_MANY, "stop")
        if count:
            request = replace(request, id=None, correlation=None)
            reason = Reason(ResultCode.TOO_MANY, "stop_more", count=count)
        report = CommandReport(request, self._reporting, is_stored=False)
        report.accept()
        report.write()
        values = {"count": count} if count else {}
        report.finish(Final(Phase.UNCONFIRMED, reason.noted(Note("may_be_turning")), values=values))
