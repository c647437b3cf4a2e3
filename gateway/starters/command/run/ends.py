"""How a command other than a stop ends: from what came of its steps to its phase and code. Pure.

A step returns a reason: a code with the fields of its text, which is in the contract's table. What is added
here is the outlook: what may be the case at the motor once something was written and not seen to act.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from gateway.contract import Note, Phase, Reason, ResultCode
from gateway.families import Expect, Procedure, command
from gateway.starters.command.report import LOOK, MAY_ACT_LATER, MAY_BE_TURNING, CommandReport, Final
from gateway.starters.command.run.decision import CAN_WAIT
from gateway.starters.command.wire import points_of

LEFT_ALONE = (ResultCode.SHUTTING_DOWN, ResultCode.BUSY)  # ends after which nothing more is written: a reload
_MAY_STAND = (*LEFT_ALONE, ResultCode.NOT_SEEN)  # ends after which a start may act later


@dataclass(slots=True)
class Outlook:
    """What a command was about to bring about."""

    report: CommandReport
    procedure: Procedure | None = None  # once it is being written
    refusal: Reason | None = None  # of a motion that may have begun all the same

    @property
    def is_run_cleared(self) -> bool:
        """Return whether it could let a run command act that stands in the starter."""
        return self.procedure is not None and self.procedure.is_run_cleared

    @property
    def note(self) -> Note:
        """Return what may be the case once something was written and not seen to act."""
        is_patient = self.report.request.verb in CAN_WAIT and not self.is_run_cleared
        return LOOK if is_patient else MAY_BE_TURNING

    def cut(self, reason: Reason) -> Final:
        """Return the end of a command that something came in the way of."""
        if self.report.is_written:
            is_pending = reason.code in _MAY_STAND and self.report.request.verb in command.TAKEN_BACK
            later = MAY_ACT_LATER if is_pending else None
            return Final(Phase.UNCONFIRMED, reason.noted(Note("written_before"), self.note, later))
        if reason.code == ResultCode.INTERNAL:
            return Final(Phase.FAILED, reason)
        return Final(Phase.REJECTED, reason.noted(Note("nothing_written")))

    def overdue(self) -> Final:
        """Return the end of a command whose time was over before all of it was written."""
        request = self.report.request
        if not self.report.is_written:
            age_s = request.until_s - request.received_s
            return self.cut(Reason(ResultCode.EXPIRED, "overdue", age_s=age_s))
        is_still = self.note is LOOK
        return self.cut(Reason(ResultCode.NOT_FOLLOWED if is_still else ResultCode.NOT_SEEN, "overdue"))

    def not_seen(self, expect: Expect) -> Final:
        """Return the end of a command that was written and not seen to act in its time."""
        point, within_s = expect.name, expect.within_s
        if self.note is LOOK:
            reason = Reason(ResultCode.NOT_FOLLOWED, "reading", point=point, within_s=within_s)
        else:
            is_off = self.is_run_cleared
            reason = Reason(
                ResultCode.NOT_SEEN, "standstill" if is_off else "motion", point=point, within_s=within_s
            )
        reason = reason if self.refusal is None else self.refusal.noted(reason)
        return Final(Phase.UNCONFIRMED, reason.noted(self.note))

    def not_readable(self) -> Final:
        """Return the end of a command whose effect cannot be read back."""
        return Final(Phase.UNCONFIRMED, Reason(ResultCode.NOT_READABLE, "command").noted(self.note))

    def stopped(self, end: Final, *, is_shown: bool) -> Final:
        """Return the end of a start that was seen not to act, and was taken back by run = 0.

        `is_shown`: two readings show run = 0 in remote mode, with the motor at rest.
        """
        if is_shown:
            phase = Phase.FAILED if self.refusal is not None else end.phase
            return replace(end.noted(Note("at_rest"), Note("taken_back")), phase=phase)
        return _doubtful(end).noted(Note("at_rest"), Note("not_taken_back"))


def crashed(verb: str, *, may_be_written: bool) -> Final:
    """Return the end of a command that was under way when an earlier run of the gateway ended."""
    reason = Reason(ResultCode.CRASHED)
    if not may_be_written:
        return Final(Phase.REJECTED, reason.noted(Note("nothing_written")))
    later = MAY_ACT_LATER if verb in command.TAKEN_BACK else None
    return Final(Phase.UNCONFIRMED, reason.noted(Note("may_be_written"), MAY_BE_TURNING, later))


def unsafe(end: Final) -> Final:
    """Return the end of a command whose starter could not be left as it was."""
    return _doubtful(end).noted(Note("not_left_safe"))


def _doubtful(end: Final) -> Final:
    """Return an end that has not merely failed."""
    return replace(end, phase=Phase.UNCONFIRMED) if end.phase is Phase.FAILED else end


def unwritten(procedure: Procedure, values: Mapping[str, Any]) -> Final:
    """Return the end of a command that has nothing to write."""
    if procedure.is_unchanged:
        return Final(Phase.CONFIRMED, Reason(ResultCode.UNCHANGED).noted(*procedure.notes), values)
    return Final(Phase.CONFIRMED, Reason(ResultCode.OK, "read"), values)


def confirmed(procedure: Procedure, values: Mapping[str, Any], after: Mapping[str, Any]) -> Final:
    """Return the end of a command that was read back: the rows that it set, and the points that were read."""
    reason = Reason(ResultCode.OK, "read_back").noted(*procedure.notes)
    return Final(Phase.CONFIRMED, reason, values, points_of(after))
