"""How a command other than a stop ends: from what came of its steps to its phase and code. Pure.

A step returns a reason: a code with the fields of its text, which is in the contract's table. What is added
here is the outlook: what may be the case at the motor once something was written and not seen to act.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from gateway.contract import Note, Phase, Reason, ResultCode
from gateway.families import Expect, Procedure, command
from gateway.starters.command.report import Final

MAY_BE_TURNING = Note("may_be_turning")
MAY_ACT_LATER = Note("may_act_later")
LOOK = Note("look")

_MAY_STAND = (ResultCode.SHUTTING_DOWN, ResultCode.NOT_SEEN)  # ends after which a start may act later


@dataclass(frozen=True, slots=True)
class Outlook:
    """What a command was about to bring about."""

    verb: str
    can_wait: bool  # its verb moves no motor
    procedure: Procedure | None = None  # once it is being written
    refusal: Reason | None = None  # of a motion that may have begun all the same

    @property
    def is_run_cleared(self) -> bool:
        """Return whether it could let a run command act that stands in the starter."""
        return self.procedure is not None and self.procedure.is_run_cleared

    @property
    def note(self) -> Note:
        """Return what may be the case once something was written and not seen to act."""
        return MAY_BE_TURNING if self.is_run_cleared or not self.can_wait else LOOK

    def cut(self, reason: Reason, *, is_written: bool) -> Final:
        """Return the end of a command that something came in the way of."""
        if is_written:
            is_pending = reason.code in _MAY_STAND and self.verb in command.TAKEN_BACK
            later = MAY_ACT_LATER if is_pending else None
            return Final(Phase.UNCONFIRMED, reason.noted(Note("written_before"), self.note, later))
        if reason.code == ResultCode.INTERNAL:
            return Final(Phase.FAILED, reason)
        return Final(Phase.REJECTED, reason.noted(Note("nothing_written")))

    def overdue(self, *, age_s: float, is_written: bool) -> Final:
        """Return the end of a command whose time was over before all of it was written."""
        if not is_written:
            return self.cut(Reason(ResultCode.EXPIRED, "overdue", age_s=age_s), is_written=False)
        if self.note is LOOK:
            return self.cut(Reason(ResultCode.NOT_FOLLOWED, "overdue"), is_written=True)
        return self.cut(Reason(ResultCode.NOT_SEEN, "overdue"), is_written=True)

    def not_seen(self, expect: Expect) -> Final:
        """Return the end of a command that was written and not seen to act in its time."""
        point, within_s = expect.name, expect.within_s
        if self.note is LOOK:
            reason = Reason(ResultCode.NOT_FOLLOWED, "reading", point=point, within_s=within_s)
            return Final(Phase.UNCONFIRMED, reason.noted(LOOK))
        if self.is_run_cleared:
            reason = Reason(ResultCode.NOT_SEEN, "standstill", point=point, within_s=within_s)
            return Final(Phase.UNCONFIRMED, reason.noted(Note("run_off_again"), MAY_BE_TURNING))
        reason = Reason(ResultCode.NOT_SEEN, "motion", point=point, within_s=within_s)
        if self.refusal is not None:
            reason = self.refusal.noted(reason)
        return Final(Phase.UNCONFIRMED, reason.noted(MAY_BE_TURNING))

    def taken_back(self, end: Final, *, is_released: bool) -> Final:
        """Return the end of a start that did not act, once run = 0 was written; `is_released`: and read."""
        if not is_released:
            return end.noted(Note("not_taken_back"))
        phase = end.phase if self.refusal is None else Phase.FAILED
        return Final(phase, end.reason.noted(Note("taken_back")), end.values, end.after)

    def not_readable(self) -> Final:
        """Return the end of a command whose effect cannot be read back."""
        return Final(Phase.UNCONFIRMED, Reason(ResultCode.NOT_READABLE, "command").noted(self.note))


def run_not_cleared(reason: Reason, phase: Phase) -> Final:
    """Return the end of a command whose run = 0 was not taken: nothing else is written."""
    return Final(phase, reason.noted(Note("nothing_else")))


def not_left_safe(end: Final) -> Final:
    """Return the end of a command that failed, and whose starter could not be left as it was."""
    if end.phase is not Phase.FAILED:
        return end
    return Final(Phase.UNCONFIRMED, end.reason.noted(Note("not_left_safe")))


def unwritten(procedure: Procedure, values: Mapping[str, Any]) -> Final:
    """Return the end of a command that has nothing to write."""
    if procedure.is_unchanged:
        return Final(Phase.CONFIRMED, Reason(ResultCode.UNCHANGED).noted(*procedure.notes), values)
    return Final(Phase.CONFIRMED, Reason(ResultCode.OK, "read"), values)


def confirmed(procedure: Procedure, values: Mapping[str, Any], after: Mapping[str, Any]) -> Final:
    """Return the end of a command that was read back: the rows that it set, and the points that were read."""
    points = {name: value for name, value in after.items() if not isinstance(value, tuple)}
    return Final(Phase.CONFIRMED, Reason(ResultCode.OK, "read_back").noted(*procedure.notes), values, points)
