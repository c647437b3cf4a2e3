"""One stop for a group: each member is stopped on its own, and the results make one for the whole."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

from gateway.contract import Note, Phase, Reason, ResultCode
from gateway.starters.command.report import CommandReport, Final, Retention

MOST_NAMED = 5  # of the members that are not confirmed


class GroupStop:
    """Gathers the members' results into the group's: confirmed only when all members are."""

    def __init__(self, report: CommandReport, members: Collection[str]) -> None:
        self._report = report
        self._missing = set(members)
        self._ends: dict[str, Final] = {}

    def member(self, name: str) -> CommandReport:
        """Return the stop of one member: reported to the same client, with the same id, but not stored."""
        request = replace(self._report.request, starter=name, correlation=None, ticket=0)
        return CommandReport(request, self._report.reporting, retention=Retention.NONE, group=self)

    def note_written(self) -> None:
        """Record that something was written to a member."""
        self._report.write()

    def note_end(self, name: str, end: Final) -> None:
        """Record a member's result; the last one ends the whole."""
        self._ends[name] = end
        self._missing.discard(name)
        if not self._missing:
            self._report.finish(self._end())

    def _end(self) -> Final:
        names = sorted(self._ends)
        values = {"members": {n: {"phase": self._ends[n].phase, "code": self._ends[n].code} for n in names}}
        others = [name for name in names if self._ends[name].phase is not Phase.CONFIRMED]
        if not others:
            return Final(Phase.CONFIRMED, Reason(ResultCode.OK, "group", count=len(names)), values)
        named = [f"{name}: {self._ends[name].code}, {self._ends[name].text}" for name in others[:MOST_NAMED]]
        reason = Reason(ResultCode.NOT_ALL, others=len(others), count=len(names), causes="; ".join(named))
        if len(others) > MOST_NAMED:
            reason = reason.noted(Note("more_members", count=len(others) - MOST_NAMED))
        return Final(self._phase(others), reason, values)

    def _phase(self, others: Collection[str]) -> Phase:
        """Return the whole's phase when not all are confirmed: rejected only when nothing was written."""
        if self._report.life.is_written:
            return Phase.UNCONFIRMED
        phases = {self._ends[name].phase for name in others}
        return Phase.REJECTED if phases == {Phase.REJECTED} else Phase.FAILED
