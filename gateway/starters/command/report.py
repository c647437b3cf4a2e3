"""What is said of one command: its phases to its client, its decisions to the audit, all to the ledger."""

from __future__ import annotations

import enum
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from math import inf
from typing import Any, Protocol

from gateway.contract import (
    STOP,
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
from gateway.starters.command.steps import CommandStep, Life
from gateway.starters.policy.write_budget import WriteBudget
from gateway.store import Journal

# What may be the case at a motor once something was written and not seen to act
MAY_BE_TURNING = Note("may_be_turning")
MAY_ACT_LATER = Note("may_act_later")
LOOK = Note("look")


@dataclass(frozen=True, slots=True)
class Final:
    """How a command ends."""

    phase: Phase
    reason: Reason
    values: Mapping[str, Any] = field(default_factory=dict)  # of the result
    after: Mapping[str, Any] = field(default_factory=dict)  # what was read back, for the audit

    @property
    def code(self) -> str:
        """Return the code of its reason."""
        return self.reason.code

    @property
    def text(self) -> str:
        """Return its reason in words."""
        return self.reason.text

    def noted(self, *more: Note | Reason | None) -> Final:
        """Return the same end with more to say."""
        return replace(self, reason=self.reason.noted(*more))


class Retention(enum.Enum):
    """Where a result is remembered, so that a repetition of its command gets it again."""

    NONE = enum.auto()  # a repetition is judged again
    RUN = enum.auto()  # as long as the gateway runs
    DISK = enum.auto()


@dataclass(frozen=True, slots=True)
class Reporting:
    """What every command is reported with."""

    records: RecordWriter
    ledger: Ledger
    journal: Journal
    write_budget: WriteBudget = field(default_factory=WriteBudget)
    stood_still_s: Callable[[], float] = lambda: -inf  # when the latest standstill ended, on the steady clock

    def now_s(self) -> float:
        """Return the steady clock's time."""
        return self.records.clock.now_s()

    def known(self, request: CommandRequest) -> ResultRecord | None:
        """Return the latest result under a command's id."""
        return self.ledger.find(request.client, request.id)

    def audit(
        self,
        request: CommandRequest,
        decision: str,
        code: str,
        *,
        before: Mapping[str, Any] | None = None,
        after: Mapping[str, Any] | None = None,
    ) -> None:
        """Record one decision about a command."""
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
                before=before or {},
                after=after or {},
                id=request.id,
                reason=request.reason,
                source=request.source,
            )
        )


class Group(Protocol):
    """A command to several starters, of which this is one member's."""

    def note_written(self) -> None:
        """Record that something was written to a member."""

    def note_end(self, name: str, end: Final) -> None:
        """Record a member's end."""


class CommandReport:
    """Reports the phases of one command: each result to its client, each decision to the audit."""

    def __init__(
        self,
        request: CommandRequest,
        reporting: Reporting,
        *,
        is_repeat: bool = False,
        retention: Retention = Retention.DISK,
        group: Group | None = None,
    ) -> None:
        self.request = request
        self.reporting = reporting
        self.life = Life()
        self.before: Mapping[str, Any] = {}  # what was read before anything was written
        self._latest: ResultRecord | None = None  # as stored
        self._is_over = False  # its final result is published
        self._retention = retention
        self._group = group
        self._is_repeat = is_repeat  # a stop whose id was used before: done again, and marked as a duplicate

    def now_s(self) -> float:
        """Return the steady clock's time."""
        return self.reporting.now_s()

    def is_outdated(self, seen_s: float) -> bool:
        """Return whether the gateway has stood still since that moment: what was read by then is old."""
        return seen_s < self.reporting.stood_still_s()

    def accept(self) -> None:
        """Say that the command will be carried out."""
        self.life.advance(CommandStep.QUEUED)
        self._decide(Final(Phase.ACCEPTED, Reason(ResultCode.OK, "accepted")))

    async def intend(self) -> None:
        """Store that this command is about to be written; CommandError when that fails."""
        if self._latest is not None:
            await self.reporting.journal.intend(self._latest)

    def write(self) -> None:
        """Say that something went out to the starter; said once, however much is written."""
        if self.life.is_written:
            return
        self.life.advance(CommandStep.VERIFYING)
        self._report(Final(Phase.WRITTEN, Reason(ResultCode.OK, "written")))
        if self._group is not None:
            self._group.note_written()

    def finish(self, end: Final) -> None:
        """Give the final result."""
        self.life.end(end.phase)
        self._decide(end)
        if self._group is not None:
            self._group.note_end(self.request.starter, end)

    def inform(self, client: str, end: Final) -> None:
        """Publish to another client what this command changed for that client; a result without an id."""
        result = self._result(end)
        self.reporting.records.put(replace(result, client=client, id=None, correlation=None, ticket=0))

    def _result(self, end: Final) -> ResultRecord:
        """Return what the client reads of such an end, or of a phase before it."""
        request = self.request
        return ResultRecord(
            starter=request.starter,
            client=request.client,
            id=request.id,
            verb=request.verb,
            phase=end.phase,
            code=end.code,
            text=joined(end.text, request.remark),
            time_s=self.reporting.records.clock.utc_s(),
            is_duplicate=self._is_repeat,
            values=end.values,
            correlation=request.correlation,
            ticket=request.ticket,
        )

    def _decide(self, end: Final) -> None:
        """Report what was decided, which the audit has as well."""
        self._report(end)
        self.reporting.audit(self.request, end.phase, end.code, before=self.before, after=end.after)

    def _report(self, end: Final) -> None:
        request, reporting = self.request, self.reporting
        ledger, now_s, result = reporting.ledger, self.now_s(), self._result(end)
        if self._retention is not Retention.DISK:
            if request.starter and request.client:  # else there is no topic for a result, only the audit
                reporting.records.put(result)
            if self._retention is Retention.RUN:
                ledger.store(result, now_s=now_s)
        elif end.phase is Phase.WRITTEN or request.verb == STOP:
            # That something may be written is on the disk already; a stop waits for no disk.
            is_under_its_id = ledger.store(result, now_s=now_s)  # else that stands for what was acted on
            self._latest = result if is_under_its_id else replace(result, id=None)
            reporting.journal.note(self._latest)
            reporting.records.put(result)
        else:
            if self._latest is None:  # a copy of the command must be known for one from now on
                ledger.store(result, now_s=now_s, is_published=False)
            self._latest = result
            reporting.journal.note(result, then=partial(self._publish_end, result))

    def _publish_end(self, result: ResultRecord) -> None:
        """Publish what is on the disk now, for repetitions too: no crash changes an end that is known.

        Without the disk the final result is published as well, and what the disk takes after it is not.
        """
        if self._is_over:
            return
        self._is_over = result.phase.is_final
        self.reporting.ledger.store(result, now_s=self.now_s())
        self.reporting.records.put(result)
