"""Answers what is too much: each client at most ten times a second, the rest by its number."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import replace

from gateway.contract import CommandRequest, Note, Phase, Reason, ResultCode
from gateway.starters.command.report import CommandReport, Final, Reporting
from gateway.system.rate_limits import REFUSAL_EVERY_S, Damped


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
