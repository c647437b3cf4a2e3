"""Which commands of a client are too many, and their answers: ten a second at most."""

from __future__ import annotations

from dataclasses import replace

from gateway.contract import CommandRequest, Phase, Reason, ResultCode
from gateway.starters.command.report import MAY_BE_TURNING, CommandReport, Final, Reporting, Retention
from gateway.starters.policy.policy import Policy
from gateway.system.rate_limits import REFUSAL_EVERY_S, Bucket, Damped, Rate

OF_CLIENT = Rate(20.0, 100)  # more than a person can send by hand
ANSWERED_STOPS = 8  # of one starter at the same time; the others are carried out all the same


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

        `is_stopped`: a stop whose frame goes out, but which is not followed up to an end of its own.
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
