"""Answers commands that are too many: for each client ten a second at most."""

from __future__ import annotations

from dataclasses import replace

from gateway.contract import CommandRequest, Note, Phase, Reason, ResultCode
from gateway.starters.command.report import CommandReport, Final, Reporting, Retention
from gateway.starters.policy.start_rules import RateLimiter, RateLimits
from gateway.system.rate_limits import REFUSAL_EVERY_S, Damped


class Overload:
    """Counts commands, and answers those beyond the limits. Keys must come from a bounded set."""

    def __init__(self, limits: RateLimits, reporting: Reporting) -> None:
        self._limiter = RateLimiter(limits)
        self._reporting = reporting
        self._answers = Damped(self._answer, clock=reporting.records.clock, every_s=REFUSAL_EVERY_S)
        self.close = self._answers.close  # reports what has only been counted

    def admits(self, client: str, starter: str) -> bool:
        """Count a command and return whether it is within all limits."""
        return self._limiter.admits(client=client, starter=starter, now_s=self._reporting.now_s())

    def answer(self, client: str, request: CommandRequest, *, is_stopped: bool = False) -> None:
        """Answer a command now, or count it; one whose id is known gets no answer.

        `is_stopped`: a stop whose frame goes out, but which is not followed up to an end of its own.
        """
        if self._reporting.known(request) is None:
            self._answers.put((client, is_stopped), (request, is_stopped))

    def _answer(self, item: tuple[CommandRequest, bool], count: int) -> None:
        (request, is_stopped), values = item, {}
        reason = Reason(ResultCode.TOO_MANY, "stop" if is_stopped else "client")
        if count:
            request, values = replace(request, id=None, correlation=None), {"count": count}
            reason = Reason(ResultCode.TOO_MANY, "stop_more" if is_stopped else "client_more", count=count)
        if not is_stopped:
            report = CommandReport(request, self._reporting, retention=Retention.RUN)
            report.finish(Final(Phase.REJECTED, reason, values))
            return
        report = CommandReport(request, self._reporting, retention=Retention.NONE)
        report.accept()
        report.write()  # rejected would mean that nothing was written
        report.finish(Final(Phase.UNCONFIRMED, reason.noted(Note("may_be_turning")), values))
