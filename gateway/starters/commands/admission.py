"""Judges commands as they come in, without reading anything; answers too many by their number."""

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
from gateway.families import Preparation, command, reading
from gateway.starters.commands.ledger import Ledger
from gateway.starters.commands.lifecycle import CommandReport, Final, Reporting
from gateway.starters.identity.first_contact import IdentityStatus, not_matching
from gateway.starters.policy.policy import Policy
from gateway.starters.policy.preconditions import STATE, Expectation, Guard, is_forbidden, refusal
from gateway.starters.policy.rights import Rights
from gateway.starters.view import StarterControlView
from gateway.store import Journal
from gateway.system.clock import Clock
from gateway.system.rate_limits import REFUSAL_EVERY_S, Damped

CAN_WAIT = frozenset({"read", "set", "configure", "output"})  # verbs that move no motor


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
        self,
        starters: Mapping[str, StarterControlView],
        rights: Rights,
        *,
        policy: Policy,
        journal: Journal,
        ledger: Ledger,
        clock: Clock,
    ) -> None:
        self._starters = starters
        self._rights = rights
        self._policy = policy
        self._groups = policy.settings.groups
        self._journal = journal
        self._ledger = ledger
        self._clock = clock

    def apply_rights(self, rights: Rights) -> None:
        """Judge by these rights and the policy's present settings from now on."""
        self._rights = rights
        self._groups = self._policy.settings.groups

    def check_sender(self, request: CommandRequest) -> None:
        """Demand a starter or group, a verb that it has, this client's right to it, and an id."""
        if request.starter in self._groups:
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
        if self._journal.trouble:
            raise CommandError(ResultCode.LEDGER_UNAVAILABLE, "trouble", trouble=self._journal.trouble)
        if not self._ledger.has_room(self._clock.now_s()):
            raise CommandError(ResultCode.LEDGER_FULL, count=len(self._ledger))

    def check(
        self, request: CommandRequest, starter: StarterControlView, load: Load
    ) -> tuple[Preparation, Guard]:
        """Return what to read before the command, and what watches over it."""
        preparation = self._check_now(request, starter, load)
        expectations = [Expectation(starter.profile, request.expect), *self._selected(request, starter)]
        guard = self._policy.guard(request, expectations)
        known = {code for read in preparation.reads for code in read.codes}
        more = reading.reads_for(starter.profile, [code for code in guard.codes if code not in known])
        return replace(preparation, reads=(*preparation.reads, *more)), guard

    def preview(self, request: CommandRequest, starter: StarterControlView, load: Load) -> None:
        """Judge a command, as if it were selected, by what was read last; nothing is counted or used up."""
        preparation = self._check_now(request, starter, load)
        points = starter.snapshot.good_values()
        command.demand(starter.profile, preparation.requires, points)
        self._policy.guard(request, ()).check(points)
        rows = starter.snapshot.rows
        if all(code in rows for read in preparation.reads for code in read.codes):
            command.build(starter.profile, starter.variant, request.verb, request.args, seen=rows)

    def _check_now(self, request: CommandRequest, starter: StarterControlView, load: Load) -> Preparation:
        """Demand what can be judged without reading, whether or not the command was selected."""
        preparation = self.check_target(request, starter)
        if load.is_busy:
            raise CommandError(ResultCode.BUSY, "command")
        if load.is_leaving:
            raise CommandError(ResultCode.BUSY, "reload")
        self._check_room(request, load)
        return preparation

    def check_target(self, request: CommandRequest, starter: StarterControlView) -> Preparation:
        """Demand that a command makes sense for a starter that answers, is known and not locked."""
        self.check_journal()
        preparation = command.prepare(starter.profile, starter.variant, request.verb, request.args)
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

    def _selected(self, request: CommandRequest, starter: StarterControlView) -> tuple[Expectation, ...]:
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
            now_s=self._clock.now_s(),
        )
        return (Expectation(starter.profile, {STATE: selection.state}, code=ResultCode.STATE_CHANGED),)

    def _check_group_sender(self, request: CommandRequest) -> None:
        if request.verb != STOP:
            raise CommandError(ResultCode.GROUP_ONLY_STOP, group=request.starter)
        if not any(self.may_stop(request.client, member) for member in self._groups[request.starter]):
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
