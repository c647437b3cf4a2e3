"""Judges commands and has them carried out: one at a time for each starter, stops at once."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import KW_ONLY, dataclass, replace
from math import inf
from typing import Any

from gateway.contract import (
    LOCK,
    OWN_VERBS,
    SELECT,
    STOP,
    CommandError,
    CommandRequest,
    EventCode,
    Phase,
    RecordWriter,
    ResultCode,
    ResultRecord,
)
from gateway.families import reading
from gateway.starters.command.admission import Admission
from gateway.starters.command.ledger import Ledger, LedgerEntry
from gateway.starters.command.overload import ANSWERED_STOPS, Overload
from gateway.starters.command.own_verbs import OwnVerbs, SetBaseline, target_of
from gateway.starters.command.report import CommandReport, CommandStep, GroupReport, Reporting, Retention
from gateway.starters.command.run.decision import judge, rows_for
from gateway.starters.command.run.ends import crashed
from gateway.starters.command.under_way import UnderWay
from gateway.starters.policy.policy import Guard, Policy
from gateway.starters.starter import StarterTelemetry
from gateway.store import Journal, Remembered


@dataclass(eq=False)
class Dispatcher:
    """Takes commands for all starters, on the app's loop; every command gets exactly one final result."""

    starters: Mapping[str, StarterTelemetry]
    _: KW_ONLY
    records: RecordWriter
    journal: Journal
    policy: Policy
    set_baseline: SetBaseline
    stood_still_s: Callable[[], float] = lambda: -inf
    on_stop: Callable[[], None] = lambda: None  # called once a stop's frames are asked for

    def __post_init__(self) -> None:
        ledger = Ledger(on_forgotten=self.journal.forget)
        self._reporting = Reporting(self.records, ledger, self.journal, self.stood_still_s)
        self._under_way = UnderWay(self.starters, self._reporting)
        self._admission = Admission(self.starters, self.policy)
        self._own_verbs = OwnVerbs(self._admission, self.policy, self.set_baseline)
        self._overload = Overload(self._reporting)
        self._is_closing = False

    def submit(self, request: CommandRequest, refusal: CommandError | None = None) -> None:
        """Judge a command at once; carry an accepted one out in a task of its own.

        One that comes with a refusal is only answered: with that, or its repetition with its first result.
        """
        error = refusal or _error_of(self._admission.check_sender, request)
        earlier = self._reporting.ledger.find(request.client, request.id)
        is_repeat = earlier is not None and earlier.is_of(request)
        if error is None and request.verb == STOP:  # never limited
            self._take_stop(request, earlier if is_repeat else None)
        elif not self._admits(request):
            self._overload.answer(self._key(request), request)
        elif error is not None and not is_repeat:
            self._refuse(request, error, is_stored=False)
        elif earlier is not None:
            self._repeat(request, earlier)
        else:
            self._carry_out(request)

    def verb_error(self, starter: str, verb: str) -> CommandError | None:
        """Return what is wrong with a verb for a starter; None when nothing is."""
        return _error_of(self._admission.check_verb, starter, verb)

    def objection(self, request: CommandRequest) -> CommandError | None:
        """Return why a command would be refused if it came now; None when it would be taken.

        Nothing is done, read or counted. A command in two steps counts as selected.
        """
        return _error_of(self._preview, request)

    def refuse_unread(self, starter: str, client: str, verb: str) -> None:
        """Refuse a command that is one too many, of which only the topic was read."""
        request = CommandRequest(starter, client, verb)
        self._overload.answer(self._key(request), request)

    def recall(self, commands: Iterable[Remembered]) -> None:
        """Record the commands of earlier runs, the oldest first; publish once what was cut short."""
        ledger, now_s = self._reporting.ledger, self._reporting.now_s()
        for result, may_be_written in commands:
            known = ledger.find(result.client, result.id)
            if known is not None and known.result.phase is not Phase.REJECTED:
                continue  # a stop that came before the ledger could be read; all else was refused
            if result.phase.is_final:
                ledger.store(result, now_s=now_s)  # its age begins now: no clock says it
            else:
                self._end_crashed(result, may_be_written=may_be_written)

    def _end_crashed(self, result: ResultRecord, *, may_be_written: bool) -> None:
        """Publish the end of a command of an earlier run, and an event where something may be written."""
        client, id_, verb = result.client, result.id, result.verb
        step = CommandStep.VERIFYING if may_be_written else CommandStep.RECEIVED
        report = CommandReport(CommandRequest(result.starter, client, verb, id_), self._reporting, step=step)
        end = crashed(verb, may_be_written=may_be_written)
        report.finish(end)
        starter = self.starters.get(result.starter)
        if starter is not None and may_be_written:
            outcome = end.reason.text
            event = starter.event
            event(EventCode.COMMAND_CUT_SHORT, client=client, id=id_, verb=verb, outcome=outcome)

    async def settle(self, starters: Collection[str], *, within_s: float) -> None:
        """Wait until these starters are under no command; they take none but stop until `reopen`."""
        await self._under_way.settle(starters, within_s=within_s)

    def stopped_s(self) -> float:
        """Return when the latest stop of any starter came, on the steady clock."""
        return self._under_way.stopped_s()

    def reopen(self) -> None:
        """Take commands for every starter again, judged by the policy's present settings and rights."""
        self._under_way.reopen()

    async def close(self) -> None:
        """Write nothing more: end every command, rejected or unconfirmed, and take no new one."""
        self._is_closing = True
        await self._under_way.close()
        self._overload.close()

    # Judging

    def _preview(self, request: CommandRequest) -> None:
        self._admission.check_sender(request)
        self._demand_open(request)
        starter = self.starters.get(request.starter)
        if request.verb == STOP or starter is None:
            return
        if request.verb in OWN_VERBS:
            self._own_verbs.judge(request, starter)
            return
        preparation = self._admission.check_target(request, starter)
        self._under_way.demand_free(request.starter)
        rows, points = rows_for(preparation, starter.snapshot.rows), starter.snapshot.good_values()
        judge(request, starter, preparation, Guard(request, self.policy), rows=rows, points=points)

    def _demand_open(self, request: CommandRequest) -> None:
        if self._is_closing:
            raise CommandError(ResultCode.SHUTTING_DOWN)
        if request.verb != STOP and (trouble := self._reporting.journal.trouble):
            raise CommandError(ResultCode.NOT_STORED, "trouble", trouble=trouble)

    def _key(self, request: CommandRequest) -> str:
        """Return whose limits a command counts against: clients without any right share theirs."""
        return request.client if self.policy.rights.is_known(request.client) else ""

    def _admits(self, request: CommandRequest) -> bool:
        return self._overload.admits(self._key(request))

    def _repeat(self, request: CommandRequest, earlier: LedgerEntry) -> None:
        """Send the stored result of a command again; an id that stood for another command is refused."""
        result = earlier.result
        if not earlier.is_of(request):
            error = CommandError(ResultCode.ID_REUSED, verb=result.verb, starter=result.starter)
            self._refuse(request, error, is_stored=False)
            return
        if earlier.is_published:  # else the answer of the first is still to come
            self._reporting.records.put(earlier.answer(request))
        self._reporting.audit(request, "duplicate", result.code)

    def _refuse(self, request: CommandRequest, error: CommandError, *, is_stored: bool) -> None:
        """Refuse a command; under an id that has a result, as a duplicate: that result stays.

        A refused id stays so, else a copy could be carried out after its client has read the refusal.
        """
        is_known = self._reporting.ledger.find(request.client, request.id) is not None
        retention = Retention.NONE if is_known else Retention.DISK if is_stored else Retention.RUN
        CommandReport(request, self._reporting, is_repeat=is_known, retention=retention).reject(error.reason)

    # Taking

    def _carry_out(self, request: CommandRequest) -> None:
        """Take a command that is not known yet."""
        try:
            self._demand_open(request)
            if request.verb in OWN_VERBS:
                self._take_own(request)
            else:
                self._take(request)
        except CommandError as refusal:
            # Without the ledger, what it has may say something else.
            self._refuse(request, refusal, is_stored=refusal.code != ResultCode.NOT_STORED)

    def _take(self, request: CommandRequest) -> None:
        """Carry out a command of a starter's family; CommandError when it cannot even begin."""
        if not self._under_way.is_busy(request.starter):  # else it is refused for that
            self._under_way.demand_decided_after_stop(request)
        starter = self.starters[request.starter]
        preparation = self._admission.check_target(request, starter)
        self._under_way.demand_free(request.starter)
        guard = self._admission.guard(request, starter)
        reads = reading.with_rows(starter.profile, preparation.reads, guard.codes)
        report = CommandReport(request, self._reporting)
        report.accept()
        self._under_way.begin(report, replace(preparation, reads=reads), guard)

    def _take_own(self, request: CommandRequest) -> None:
        """Carry out one of the gateway's own verbs; CommandError when it must not be."""
        deed = self._own_verbs.judge(request, self.starters[request.starter])
        if request.verb == SELECT:
            self._under_way.demand_decided_after_stop(target_of(request))
        report = CommandReport(request, self._reporting)
        report.accept()
        self._under_way.do(report, deed)
        if request.verb == LOCK:
            self._under_way.cut_for_lock(request.starter)

    def _take_stop(self, request: CommandRequest, earlier: LedgerEntry | None) -> None:
        """Stop a starter, or all members of a group that this client may stop; answer what can be.

        `earlier`: the same stop under the same id. While that is under way, its end is the answer.
        """
        names = self._admission.stoppable(request)
        is_full = any(self._under_way.answered_stops(name) >= ANSWERED_STOPS for name in names)
        if not self._is_closing:
            # Before anything is published: that takes longer than the line's silence.
            self._stop_all(names, request.received_s)
        if earlier is not None and not earlier.result.phase.is_final:
            if self._admits(request):
                self._repeat(request, earlier)
            return
        if self._is_closing:
            self._refuse(request, CommandError(ResultCode.SHUTTING_DOWN), is_stored=False)
            return
        if is_full:
            self._overload.answer(self._key(request), request, is_stopped=True)
            return
        is_repeat = earlier is not None
        report = CommandReport(request, self._reporting, is_repeat=is_repeat, retention=Retention.BEHIND)
        report.accept()
        if request.starter in self.starters:
            self._under_way.join(report)
            return
        members = self._admission.members(request)
        whole = GroupReport(report, members)
        for member in map(whole.member, members):
            if member.request.starter in names:
                member.accept()
                self._under_way.join(member)
            else:
                member.reject(self._admission.no_right(member.request).reason)

    def _stop_all(self, names: Iterable[str], came_s: float) -> None:
        for name in names:
            self.policy.selections.end(name)  # what was decided upon before the stop is decided again
            self._under_way.stop(name, came_s)
        self.on_stop()


def _error_of(check: Callable[..., None], *args: Any) -> CommandError | None:
    """Return the CommandError that a check raises; None when it raises none."""
    try:
        check(*args)
    except CommandError as error:
        return error
    return None
