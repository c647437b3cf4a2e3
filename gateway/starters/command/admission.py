"""Which commands may come in: judged without reading anything, and at most so many a second of a client."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from math import inf

from gateway.contract import (
    OWN_VERBS,
    SELECT,
    STOP,
    CommandError,
    CommandRequest,
    Phase,
    Reason,
    ResultCode,
)
from gateway.families import Preparation, command
from gateway.starters.command.proofs import Proofs
from gateway.starters.command.report import MAY_BE_TURNING, CommandReport, Final, Reporting, Retention
from gateway.starters.command.run.decision import CAN_WAIT, demand_identified
from gateway.starters.policy.freshness import MAX_AHEAD_S
from gateway.starters.policy.policy import Guard, Policy
from gateway.starters.policy.preconditions import STATE, Expectation, demand_unlocked, is_forbidden
from gateway.starters.starter import StarterTelemetry
from gateway.system.rate_limits import REFUSAL_EVERY_S, Bucket, Damped, Rate

OF_CLIENT = Rate(20.0, 100)  # more than a person can send by hand


class Overload:
    """Counts commands, and answers those beyond the limit; clients without any right share theirs."""

    def __init__(self, reporting: Reporting, policy: Policy) -> None:
        self._reporting, self._policy = reporting, policy
        self._buckets: dict[str, Bucket] = {}  # by client
        self._answers = Damped(self._answer, clock=reporting.records.clock, every_s=REFUSAL_EVERY_S)
        self.close = self._answers.close  # reports what has only been counted

    def admits(self, request: CommandRequest) -> bool:
        """Count a command and return whether it is within the limit of its client."""
        bucket = self._buckets.setdefault(self._client(request), Bucket(OF_CLIENT))
        return bucket.take(self._reporting.records.clock.now_s())

    def answer(self, request: CommandRequest, *, is_stopped: bool = False) -> None:
        """Answer a command now, or count it; one whose id is known gets no answer.

        `is_stopped`: a stop that shares its frame with others, and is not followed up to an end of its own.
        """
        if self._reporting.ledger.find(request.client, request.id) is None:
            self._answers.put((self._client(request), is_stopped), (request, is_stopped))

    def _client(self, request: CommandRequest) -> str:
        return request.client if self._policy.rights.is_known(request.client) else ""

    def _answer(self, item: tuple[CommandRequest, bool], count: int) -> None:
        (request, is_stopped), values = item, {}
        reason = Reason(ResultCode.TOO_MANY, "stop" if is_stopped else "client")
        if count:
            request, values = replace(request, id=None, correlation=None), {"count": count}
            reason = Reason(ResultCode.TOO_MANY, "stop_more" if is_stopped else "client_more", count=count)
        retention = Retention.NONE if is_stopped else Retention.RUN
        report, phase = CommandReport(request, self._reporting, retention=retention), Phase.REJECTED
        if is_stopped:
            report.accept()
            report.write()  # rejected would mean that nothing was written
            reason, phase = reason.noted(MAY_BE_TURNING), Phase.UNCONFIRMED
        report.finish(Final(phase, reason, values))


@dataclass
class Admission:
    """Every method that checks raises CommandError for a command that must not be."""

    starters: Mapping[str, StarterTelemetry]
    policy: Policy
    proofs: Proofs

    def __post_init__(self) -> None:
        self._stopped_s: dict[str, float] = {}  # by starter: when its latest stop came

    def note_stop(self, name: str, came_s: float) -> None:
        """Let nothing count that was decided upon before a stop came, on the steady clock."""
        self._stopped_s[name] = max(came_s, self._stopped_s.get(name, -inf))
        self.policy.selections.end(name)

    def stopped_s(self) -> float:
        """Return when the latest stop of any starter came, on the steady clock."""
        return max(self._stopped_s.values(), default=-inf)

    def admit(self, request: CommandRequest) -> CommandRequest:
        """Return a command that may come in; all but a stop with the time at which it was decided upon."""
        if unknown := self.verb_error(request.starter, request.verb):
            raise unknown
        if request.verb != STOP:
            request = self.proofs.dated(request, self.policy.rights)
        self.check_sender(request)
        return request

    def check_sender(self, request: CommandRequest) -> None:
        """Demand a starter or group, this client's right to the verb, and an id."""
        name, is_stop = request.starter, request.verb == STOP
        is_group = name in self.policy.settings.groups
        if is_group and not is_stop:
            raise CommandError(ResultCode.GROUP_ONLY_STOP, group=name)
        if not is_group and name not in self.starters:
            raise CommandError(ResultCode.UNKNOWN_STARTER)
        if not (self.stoppable(request) if is_stop else self._may(request)):
            raise self.no_right(request)
        if not is_stop and not request.id:
            raise CommandError(ResultCode.NO_ID)

    def verb_error(self, name: str, verb: str) -> CommandError | None:
        """Return why a starter has no such verb; one that is not configured has any."""
        starter = self.starters.get(name)
        if starter is None or verb in (known := (*command.verbs(starter.profile), *OWN_VERBS)):
            return None
        verbs, title = ", ".join(known), starter.profile.title
        return CommandError(ResultCode.UNKNOWN_VERB, "starter", title=title, verb=verb[:40], verbs=verbs)

    def no_right(self, request: CommandRequest) -> CommandError:
        """Return the refusal of a command to which its client has no right."""
        client, verb, starter = request.client, request.verb, request.starter
        return CommandError(ResultCode.NOT_ALLOWED, client=client, verb=verb, starter=starter)

    def members(self, request: CommandRequest) -> Collection[str]:
        """Return the starters that a command is for: those of a group, or the one."""
        return self.policy.settings.groups.get(request.starter, (request.starter,))

    def stoppable(self, request: CommandRequest) -> list[str]:
        """Return the starters that a stop is for and its client may stop."""
        allowed, client = self.policy.rights.is_allowed, request.client
        return [name for name in self.members(request) if allowed(client, verb=STOP, starter=name)]

    def check_target(self, request: CommandRequest, starter: StarterTelemetry) -> Preparation:
        """Demand that a command makes sense for a starter that answers, is known and not locked.

        The refusal of an old wish names the stop, whatever else is wrong with it.
        """
        self._demand_decided_after_stop(request)
        is_local = starter.snapshot.good_values().get("remote") is False
        preparation = command.prepare(
            starter.profile, starter.variant, request.verb, request.args, is_local=is_local
        )
        demand_unlocked(request, self.policy.motor_history)
        demand_identified(request, starter)
        return preparation

    def guard(self, request: CommandRequest, starter: StarterTelemetry) -> Guard:
        """Return what watches over a command until its write; its selection, if it has one, is used up."""
        expectations = [Expectation(starter.profile, request.expect)]
        if request.select is not None:
            selection = self.policy.selections.take(request, now_s=self.policy.clock.now_s())
            seen = {STATE: selection.state}
            expectations.append(Expectation(starter.profile, seen, ResultCode.STATE_CHANGED))
        elif request.verb in self.policy.settings.of(request.starter).two_step:
            raise CommandError(ResultCode.SELECT_FIRST, verb=request.verb)
        return Guard(request, self.policy, expectations)

    def _demand_decided_after_stop(self, request: CommandRequest) -> None:
        """Refuse what came before the latest stop of its starter; what may move the motor also when it
        came later, but may have been decided upon before.
        """
        stopped_s = self._stopped_s.get(request.starter, -inf)
        if request.received_s <= stopped_s:
            raise CommandError(ResultCode.STOPPED_FIRST, "overtaken")
        if request.verb in CAN_WAIT or not is_forbidden(request.verb, request.args):
            return
        if request.decided_s is not None and request.decided_s < stopped_s:
            raise CommandError(ResultCode.STOPPED_FIRST, "decided", ahead_s=MAX_AHEAD_S)

    def _may(self, request: CommandRequest) -> bool:
        """Return whether the client has the right; who may do something may also select it."""
        verb = str(request.args.get("verb")) if request.verb == SELECT else request.verb
        return self.policy.rights.is_allowed(request.client, verb=verb, starter=request.starter)
