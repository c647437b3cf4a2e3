"""One command's life: its step, its results to the client and its decisions to the audit, all in the ledger.

The published phases follow from the steps: `accepted` with QUEUED, `written` with VERIFYING. What has not
reached VERIFYING has written nothing, so that it may be decided again, and be rejected.
"""

from __future__ import annotations

import enum
from collections.abc import Callable, Collection, Mapping
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import partial
from typing import Any

from gateway.contract import (
    AuditRecord,
    CommandRequest,
    Note,
    Phase,
    Reason,
    RecordWriter,
    ResultCode,
    ResultRecord,
    joined,
)
from gateway.starters.command.ledger import Ledger
from gateway.store import Journal

# What may be the case at a motor once something was written and not seen to act
MAY_BE_TURNING = Note("may_be_turning")
MAY_ACT_LATER = Note("may_act_later")
LOOK = Note("look")


class CommandStep(enum.Enum):
    """Where a command is."""

    RECEIVED = "received"
    QUEUED = "queued"  # accepted; it waits for a slot on its line, or needs none
    READING = "reading"  # what decides is being read
    DECIDED = "decided"  # two readings in a row lead to the same writes
    WRITING = "writing"  # the first write is handed to the line
    VERIFYING = "verifying"  # something has, or may have, reached the starter
    DONE = "done"  # by a final phase


_S, _P = CommandStep, Phase
NEXT: Mapping[CommandStep, Collection[CommandStep | Phase]] = {  # the steps, and the ends by their phase
    _S.RECEIVED: {_S.QUEUED, _P.REJECTED},
    # A stop reads nothing first; the gateway's own verbs are confirmed without any step.
    _S.QUEUED: {_S.READING, _S.VERIFYING, _P.REJECTED, _P.FAILED, _P.CONFIRMED},
    _S.READING: {_S.DECIDED, _P.REJECTED, _P.FAILED},
    # What was read may have grown old; a read, or a value that the starter held already, is confirmed.
    _S.DECIDED: {_S.WRITING, _S.READING, _P.REJECTED, _P.FAILED, _P.CONFIRMED},
    # It may not have been sent in time; run = 0 may be refused, and the next write is the first.
    _S.WRITING: {_S.WRITING, _S.VERIFYING, _S.READING, _P.REJECTED, _P.FAILED},
    _S.VERIFYING: {_P.CONFIRMED, _P.FAILED, _P.UNCONFIRMED},  # never "nothing written"
    _S.DONE: set(),
}


@dataclass(frozen=True, slots=True)
class Final:
    """How a command ends."""

    phase: Phase
    reason: Reason
    values: Mapping[str, Any] = field(default_factory=dict)  # of the result
    after: Mapping[str, Any] = field(default_factory=dict)  # what was read back, for the audit

    def noted(self, *more: Note | Reason | None) -> Final:
        """Return the same end with more to say."""
        return replace(self, reason=self.reason.noted(*more))


class Retention(enum.Enum):
    """Who has the results: the client and, so that a repetition gets them again, memory or disk."""

    AUDIT = enum.auto()  # no client asked: the audit alone
    NONE = enum.auto()  # a repetition is judged again
    RUN = enum.auto()  # as long as the gateway runs
    BEHIND = enum.auto()  # the disk, for which a stop does not wait
    DISK = enum.auto()  # which has a result before it is published


@dataclass(frozen=True, slots=True)
class Reporting:
    """What every command is reported with."""

    records: RecordWriter
    ledger: Ledger
    journal: Journal
    stood_still_s: Callable[[], float]  # when the latest standstill ended, on the steady clock

    def publish(self, result: ResultRecord, request: CommandRequest) -> None:
        """Publish a result of a command, and hand it to that command's follower."""
        self.records.put(result)
        if request.follow is not None:
            request.follow(result)

    def audit(self, request: CommandRequest, decision: str, code: str, **sides: Any) -> None:
        """Record one decision about a command; `sides` are the points `before` and `after` its write."""
        records = self.records
        records.put(
            AuditRecord(
                starter=request.starter,
                client=request.client,
                operator=request.operator,
                verb=request.verb,
                args=request.args,
                decision=decision,
                code=code,
                time_s=records.clock.utc_s(),
                seq=next(records.sequence),
                boot=records.boot,
                id=request.id,
                reason=request.reason,
                source=request.source,
                **sides,
            )
        )


@dataclass(slots=True, eq=False)
class CommandReport:
    """One command's step and results; a step or an end that the table does not list raises ValueError."""

    request: CommandRequest
    reporting: Reporting
    _: KW_ONLY
    is_repeat: bool = False  # a stop whose id was used before: done again, and marked as a duplicate
    retention: Retention = Retention.DISK
    group: GroupReport | None = None
    step: CommandStep = CommandStep.RECEIVED
    is_written: bool = False  # something has, or may have, reached the starter
    before: Mapping[str, Any] = field(default_factory=dict)  # what was read before anything was written
    _latest: ResultRecord | None = None  # as stored
    _is_over: bool = False  # its final result is published

    def advance(self, to: CommandStep | Phase) -> None:
        """Go on to another step, or to the end with this phase."""
        if to not in NEXT[self.step]:
            raise ValueError(f"a command that is {self.step.value} cannot become {to.value}")
        self.step = to if isinstance(to, CommandStep) else CommandStep.DONE
        self.is_written |= to is CommandStep.VERIFYING

    def accept(self) -> None:
        """Say that the command will be carried out."""
        self.advance(CommandStep.QUEUED)
        self._decide(Final(Phase.ACCEPTED, Reason(ResultCode.OK, "accepted")))

    async def intend(self) -> None:
        """Store that this command is about to be written; CommandError when that fails."""
        if self._latest is not None:
            await self.reporting.journal.intend(self._latest)

    def write(self) -> None:
        """Say that something went out to the starter; said once, however much is written."""
        if self.is_written:
            return
        self.advance(CommandStep.VERIFYING)
        self._report(Final(Phase.WRITTEN, Reason(ResultCode.OK, "written")))
        if self.group is not None:
            self.group.whole.write()

    def finish(self, end: Final) -> None:
        """Give the final result."""
        self.advance(end.phase)
        self._decide(end)
        if self.group is not None:
            self.group.note_end(self.request.starter, end)

    def reject(self, reason: Reason) -> None:
        """Give the final result of a command that is not carried out."""
        self.finish(Final(Phase.REJECTED, reason))

    def inform(self, client: str, end: Final) -> None:
        """Publish to another client what this command changed for that client; a result without an id."""
        result = self._result(end)
        self.reporting.records.put(replace(result, client=client, id=None, correlation=None))

    def _result(self, end: Final) -> ResultRecord:
        """Return what the client reads of such an end, or of a phase before it."""
        request = self.request
        return ResultRecord(
            starter=request.starter,
            client=request.client,
            id=request.id,
            verb=request.verb,
            phase=end.phase,
            code=end.reason.code,
            text=joined(end.reason.text, request.remark),
            time_s=self.reporting.records.clock.utc_s(),
            is_duplicate=self.is_repeat,
            values=end.values,
            correlation=request.correlation,
        )

    def _decide(self, end: Final) -> None:
        """Report what was decided, which the audit has as well."""
        self._report(end)
        sides = {"before": self.before, "after": end.after}
        self.reporting.audit(self.request, end.phase, end.reason.code, **sides)

    def _report(self, end: Final) -> None:
        result, ledger, journal = self._result(end), self.reporting.ledger, self.reporting.journal
        if self.retention is Retention.AUDIT:
            return
        # That something may be written is on the disk already.
        if self.retention is Retention.DISK and end.phase is not Phase.WRITTEN:
            if self._latest is None:  # a copy of the command must be known for one from now on
                ledger.store(result, is_published=False)
            self._latest = result
            journal.note(result, then=partial(self._publish_end, result))
            return
        is_known = self.retention is not Retention.NONE and ledger.store(result)
        if self.retention is Retention.BEHIND:
            # Where the ledger keeps the result of another command under this id, a stop is stored without it.
            journal.note(result if is_known else replace(result, id=None))
        if result.starter and result.client:  # else there is no topic for a result, only the audit
            self.reporting.publish(result, self.request)

    def _publish_end(self, result: ResultRecord) -> None:
        """Publish what is on the disk now, for repetitions too: no crash changes an end that is known.

        Without the disk the final result is published as well, and what the disk takes after it is not.
        """
        if self._is_over:
            return
        self._is_over = result.phase.is_final
        self.reporting.ledger.store(result)
        self.reporting.publish(result, self.request)


class GroupReport:
    """The stop of a group: each member is stopped on its own, and their ends make one for the whole."""

    def __init__(self, whole: CommandReport, members: Collection[str]) -> None:
        self.whole = whole
        self._ends: dict[str, Final | None] = dict.fromkeys(sorted(members))

    def member(self, name: str) -> CommandReport:
        """Return the stop of one member: reported to the same client, with the same id, but not stored."""
        request = replace(self.whole.request, starter=name, correlation=None, follow=None)
        return CommandReport(request, self.whole.reporting, retention=Retention.NONE, group=self)

    def note_end(self, name: str, end: Final) -> None:
        """Record a member's end; the last one ends the whole, confirmed only when all members are."""
        self._ends[name] = end
        ends = {name: end for name, end in self._ends.items() if end is not None}
        if len(ends) == len(self._ends):
            self.whole.finish(self._end(ends))

    def _end(self, ends: Mapping[str, Final]) -> Final:
        values = {"members": {name: {"phase": e.phase, "code": e.reason.code} for name, e in ends.items()}}
        others = {name: end for name, end in ends.items() if end.phase is not Phase.CONFIRMED}
        if not others:
            return Final(Phase.CONFIRMED, Reason(ResultCode.OK, "group", count=len(ends)), values)
        reason = Reason(ResultCode.NOT_ALL, others=len(others), count=len(ends), names=", ".join(others))
        if self.whole.is_written:
            return Final(Phase.UNCONFIRMED, reason, values)
        is_rejected = {end.phase for end in others.values()} == {Phase.REJECTED}
        return Final(Phase.REJECTED if is_rejected else Phase.FAILED, reason, values)
