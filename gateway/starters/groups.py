"""Stops for a group of starters: each member's own, told apart, and one result for the whole."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

from gateway.starters.errand import Desk, End, Errand
from gateway.starters.records import Phase
from gateway.starters.request import CommandRequest


class GroupStop:
    """Gathers the members' results into the group's: confirmed only when all members are."""

    def __init__(self, errand: Errand, members: Collection[str], desk: Desk) -> None:
        self._errand = errand
        self._missing = set(members)
        self._ends: dict[str, End] = {}
        self._desk = desk

    def member(self, name: str) -> Errand:
        """Return the stop of one member: reported to the same client, with the same id, but kept nowhere."""
        request = replace(self._errand.request, starter=name, correlation=None, response_topic=None)
        return _MemberErrand(request, self._desk, whole=self)

    def note_written(self) -> None:
        """Take over that something was written to a member."""
        self._errand.write()

    def note_end(self, name: str, end: End) -> None:
        """Take over a member's result; the last one ends the whole."""
        self._ends[name] = end
        self._missing.discard(name)
        if not self._missing:
            self._errand.finish(self._end())

    def _end(self) -> End:
        names = sorted(self._ends)
        values = {"members": {n: {"phase": self._ends[n].phase, "code": self._ends[n].code} for n in names}}
        others = [name for name in names if self._ends[name].phase is not Phase.CONFIRMED]
        if not others:
            return End(Phase.CONFIRMED, "ok", f"all {len(names)} read back from their starters", values)
        told = "; ".join(f"{name}: {self._ends[name].code}, {self._ends[name].text}" for name in others[:5])
        more = f"; and {len(others) - 5} more" if len(others) > 5 else ""
        text = f"{len(others)} of {len(names)} not confirmed: {told}{more}"
        return End(self._phase(others), "not_all", text, values)

    def _phase(self, others: Collection[str]) -> Phase:
        """Return the whole's phase when not all are confirmed: rejected only when nothing was written."""
        if self._errand.life.is_written:
            return Phase.UNCONFIRMED
        phases = {self._ends[name].phase for name in others}
        return Phase.REJECTED if phases == {Phase.REJECTED} else Phase.FAILED


class _MemberErrand(Errand):
    """One member's stop, which tells the whole how it goes."""

    def __init__(self, request: CommandRequest, desk: Desk, *, whole: GroupStop) -> None:
        super().__init__(request, desk, is_kept=False)
        self._whole = whole

    def write(self) -> None:
        """Say that something went out to the starter."""
        super().write()
        self._whole.note_written()

    def finish(self, end: End, *, is_kept: bool = True) -> None:
        """Give the final result."""
        super().finish(end, is_kept=is_kept)
        self._whole.note_end(self.request.starter, end)
