"""Which commands of a client are too many, and their answers: ten a second at most."""

from __future__ import annotations

from dataclasses import replace

from gateway.contract import CommandRequest, Phase, Reason, ResultCode
from gateway.starters.command.report import MAY_BE_TURNING, CommandReport, Final, Reporting, Retention
from gateway.system.rate_limits import REFUSAL_EVERY_S, Bucket, Damped, Rate

OF_CLIENT = Rate(20.0, 100)  # more than a person can send by hand
ANSWERED_STOPS = 8  # of one starter at the same time; the others are carried out all the same


class Overload:
    """Counts commands, and answers those beyond the limit. Clients: of a bounded set."""

    def __init__(self, reporting: Reporting) -> None:
        self._reporting = reporting
        self._buckets: dict[str, Bucket] = {}  # by client
        self._answers = Damped(self._answer, clock=reporting.records.clock, every_s=REFUSAL_EVERY_S)
        self.close = self._answers.close  # reports what has only been counted

    def admits(self, client: str) -> bool:
        """Count a command and return whether it is within the limit of its client."""
        return self._buckets.setdefault(client, Bucket(OF_CLIENT)).take(self._reporting.now_s())

    def answer(self, client: str, request: CommandRequest, *, is_stopped: bool = False) -> None:
        """Answer a command now, or count it; one whose id is known gets no answer.

        `is_stopped`: a stop whose frame goes out, but which is not followed up to an end of its own.
        """
        if self._reporting.ledger.find(request.client, request.id) is None:
            self._answers.put((client, is_stopped), (request, is_stopped))

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
