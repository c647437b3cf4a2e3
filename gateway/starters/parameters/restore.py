"""Carries a restore out: one change after the other, each read back, up to the first that fails."""

from __future__ import annotations

import uuid
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field

from gateway.contract import (
    CommandRequest,
    Note,
    Phase,
    Reason,
    Record,
    RecordWriter,
    ResultCode,
    ResultRecord,
)
from gateway.families import decode, diagnosis
from gateway.starters.command.ledger import Ledger
from gateway.starters.command.report import CommandReport, Reporting
from gateway.starters.command.run.pipeline import CommandRun
from gateway.starters.parameters.offline_starter import OfflineStarter
from gateway.starters.parameters.restore_plan import PlannedWrite, RestorePlan, prepare_change
from gateway.starters.policy.write_budget import WriteBudget
from gateway.system.clock import Clock

CLIENT = "parameters"
CLEARED = Note("run_cleared").text
NO_LIMIT = 1_000_000  # writes an hour: a person restores what a person chose, each row once


@dataclass(slots=True)
class RestoreEnd:
    """What became of a restore; `failure` is None when everything was written and read back."""

    done: list[PlannedWrite] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)  # what the results of those done say besides, each once
    failed: tuple[PlannedWrite, ...] = ()
    failure: ResultRecord | None = None
    untried: tuple[PlannedWrite, ...] = ()


class Restore:
    """One restore under way."""

    def __init__(self, starter: OfflineStarter, plan: RestorePlan, *, clock: Clock) -> None:
        self._starter = starter
        self._plan = plan
        self._finals = _Finals()
        self._write_budget = WriteBudget(most_per_hour=NO_LIMIT)
        self._reporting = Reporting(
            records=RecordWriter(self._finals, clock),
            ledger=Ledger(),
            write_budget=self._write_budget,
        )
        self._command: CommandRun | None = None
        self._is_interrupted = False

    @property
    def writes(self) -> int:
        """How many writes have gone to the starter's non-volatile memory so far."""
        return self._write_budget.total(self._starter.setup.name)

    def interrupt(self) -> None:
        """Write nothing more, but leave the starter safe."""
        self._is_interrupted = True
        if self._command is not None:
            self._command.halt(Reason(ResultCode.INTERRUPTED))

    async def run(self, on_begin: Callable[[tuple[PlannedWrite, ...]], None]) -> RestoreEnd:
        """Write the changes in their order; `on_begin` gets each group before it is written."""
        end = RestoreEnd()
        groups = list(_groups(self._plan.changes))
        for place, group in enumerate(groups):
            rest = tuple(change for later in groups[place + 1 :] for change in later)
            if self._is_interrupted:
                end.untried = (*group, *rest)
                return end
            on_begin(group)
            result = await self._carry_out(group)
            if result.phase is not Phase.CONFIRMED:
                end.failed, end.failure, end.untried = group, result, rest
                return end
            end.done += group
            if CLEARED in result.text and CLEARED not in end.notes:
                end.notes.append(CLEARED)
        return end

    async def _carry_out(self, group: tuple[PlannedWrite, ...]) -> ResultRecord:
        verb, args = _command(group)
        starter = self._starter
        preparation = diagnosis.with_distinctive_rows(
            starter.profile, prepare_change(starter.profile, starter.variant, verb, args)
        )
        now_s = self._reporting.records.clock.now_s()
        request = CommandRequest(starter.setup.name, CLIENT, verb, uuid.uuid4().hex, args, received_s=now_s)
        report = CommandReport(request, self._reporting)
        report.accept()
        self._command = CommandRun(report, starter, preparation)
        await self._command.run()
        self._command = None
        return self._finals.take()


class _Finals:
    """Keeps the final result of the command under way."""

    def __init__(self) -> None:
        self._results: list[ResultRecord] = []

    def put(self, record: Record) -> None:
        if isinstance(record, ResultRecord) and record.phase.is_final:
            self._results.append(record)

    def take(self) -> ResultRecord:
        return self._results.pop()


def _groups(changes: tuple[PlannedWrite, ...]) -> Iterator[tuple[PlannedWrite, ...]]:
    """Yield what one command writes: each change alone, all configuration registers of an SST together."""
    together = tuple(change for change in changes if change.is_configuration)
    if together:
        yield together
    yield from ((change,) for change in changes if not change.is_configuration)


def _command(group: tuple[PlannedWrite, ...]) -> tuple[str, Mapping[str, decode.Value]]:
    if group[0].is_configuration:
        return "configure", {change.code: change.value for change in group}
    return "set", {"parameter": group[0].code, "value": group[0].value}
