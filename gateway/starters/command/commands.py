"""`Commands.submit`: the one way in for commands, whether they come by MQTT, the page or Sparkplug.

1. A stop is carried out at once. Every other command is admitted first (`admission`), under a new id.
2. Each starter has one command under way (`under_way`); every command gets exactly one final result.
3. The sender may follow the results, which are published as well: `async for result in submit(...)`.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial

from gateway.contract import (
    OWN_VERBS,
    STOP,
    CommandError,
    CommandRequest,
    EventCode,
    Phase,
    RecordWriter,
    ResultCode,
    ResultRecord,
)
from gateway.families import Preparation, reading
from gateway.starters.command.admission import Admission, Overload
from gateway.starters.command.ledger import Ledger, LedgerEntry
from gateway.starters.command.own_verbs import OwnVerbs, SetBaseline
from gateway.starters.command.proofs import Proofs
from gateway.starters.command.report import CommandReport, CommandStep, GroupReport, Reporting, Retention
from gateway.starters.command.run.decision import judge
from gateway.starters.command.run.ends import crashed
from gateway.starters.command.under_way import UnderWay
from gateway.starters.policy.policy import Guard, Policy
from gateway.starters.starter import StarterTelemetry
from gateway.store import Journal, Remembered

Results = AsyncIterator[ResultRecord]  # of one command as they come, up to the final one


@dataclass(eq=False, kw_only=True)
class Commands:
    """Takes commands for all starters. All calls on the app's loop."""

    starters: Mapping[str, StarterTelemetry]
    policy: Policy
    proofs: Proofs
    records: RecordWriter
    journal: Journal
    set_baseline: SetBaseline
    on_stop: Callable[[], None]  # called once a stop's frames are asked for

    def __post_init__(self) -> None:
        ledger = Ledger(now_s=self.records.clock.now_s, on_forgotten=self.journal.forget)
        self._reporting = Reporting(self.records, ledger, self.journal, self.proofs.suspend_watch.ended_s)
        self.under_way = UnderWay(self.starters)
        self.admission = Admission(self.starters, self.policy, self.proofs)
        self._own_verbs = OwnVerbs(self.admission, self.policy, self.set_baseline)
        self._overload = Overload(self._reporting, self.policy)

    def submit(self, request: CommandRequest, refusal: CommandError | None = None) -> Results:
        """Judge a command at once; carry an accepted one out in a task of its own.

        One that comes with a refusal is not fit to be judged; a repetition gets the first one's result. The
        results of a group's stop are the group's own, without its members'.
        """
        came = asyncio.Queue[ResultRecord]()
        request = replace(request, follow=came.put_nowait)
        try:
            request = request if refusal else self.admission.admit(request)
        except CommandError as error:
            refusal = error
        self._answer(request, refusal)
        return _followed(came)

    def objection(self, request: CommandRequest) -> CommandError | None:
        """Return why a command would be refused if it came now; None when it would be taken.

        Nothing is done, read or counted. A command in two steps counts as selected.
        """
        try:
            self.admission.check_sender(request)
            self._demand_open(request.verb)
            if request.verb != STOP:
                self._preview(request, self.starters[request.starter])
        except CommandError as error:
            return error
        return None

    def refuse_unread(self, starter: str, client: str, verb: str) -> None:
        """Refuse a command that is one too many, of which only the topic was read."""
        self._overload.answer(CommandRequest(starter, client, verb))

    def recall(self, commands: Iterable[Remembered]) -> None:
        """Record the commands of earlier runs, the oldest first; publish once what was cut short."""
        ledger = self._reporting.ledger
        for result, may_be_written in commands:
            known = ledger.find(result.client, result.id)
            if known is not None and known.result.phase is not Phase.REJECTED:
                continue  # a stop that came before the ledger could be read; all else was refused
            if result.phase.is_final:
                ledger.store(result)  # its age begins now: no clock says it
            else:
                self._end_crashed(result, may_be_written=may_be_written)

    async def close(self) -> None:
        """Write nothing more: end every command, rejected or unconfirmed, and take no new one."""
        await self.under_way.close()
        self._overload.close()

    def _end_crashed(self, result: ResultRecord, *, may_be_written: bool) -> None:
        """Publish the end of a command of an earlier run, and an event where something may be written."""
        name, client, id_, verb = result.starter, result.client, result.id, result.verb
        step = CommandStep.VERIFYING if may_be_written else CommandStep.RECEIVED
        end = crashed(verb, may_be_written=may_be_written)
        CommandReport(CommandRequest(name, client, verb, id_), self._reporting, step=step).finish(end)
        if may_be_written and name in self.starters:
            event, outcome = self.starters[name].event, end.reason.text
            event(EventCode.COMMAND_CUT_SHORT, client=client, id=id_, verb=verb, outcome=outcome)

    # Judging

    def _preview(self, request: CommandRequest, starter: StarterTelemetry) -> None:
        if request.verb in OWN_VERBS:
            self._own_verbs.judge(request, starter)
            return
        preparation = self._prepared(request, starter)
        known, points = starter.snapshot.rows, starter.snapshot.good_values()
        judge(request, starter, preparation, Guard(request, self.policy), known=known, points=points)

    def _demand_open(self, verb: str) -> None:
        if self.under_way.is_closing:
            raise CommandError(ResultCode.SHUTTING_DOWN)
        if verb != STOP and (trouble := self.journal.trouble):
            raise CommandError(ResultCode.NOT_STORED, "trouble", trouble=trouble)

    def _answer(self, request: CommandRequest, refusal: CommandError | None) -> None:
        """Carry out a command that is admitted and new; answer any other."""
        earlier = self._reporting.ledger.find(request.client, request.id)
        is_repeat = earlier is not None and earlier.is_of(request)
        if refusal is None and request.verb == STOP:  # never limited
            self._take_stop(request, earlier if is_repeat else None)
        elif not self._overload.admits(request):
            self._overload.answer(request)
        elif earlier is not None and is_repeat:
            self._repeat(request, earlier)
        elif refusal is not None:
            self._refuse(request, refusal)
        elif earlier is not None:
            verb, starter = earlier.result.verb, earlier.result.starter
            self._refuse(request, CommandError(ResultCode.ID_REUSED, verb=verb, starter=starter))
        else:
            self._take(request)

    def _repeat(self, request: CommandRequest, earlier: LedgerEntry) -> None:
        """Send the stored result of a command again."""
        if earlier.is_published:  # else the answer of the first is still to come
            self._reporting.publish(earlier.answer(request), request)
        self._reporting.audit(request, "duplicate", earlier.result.code)

    def _refuse(self, request: CommandRequest, error: CommandError, keep: Retention = Retention.RUN) -> None:
        """Refuse a command; under an id that has a result, as a duplicate: that result stays.

        A refused id stays so, else a copy could be carried out after its client has read the refusal.
        """
        is_known = self._reporting.ledger.find(request.client, request.id) is not None
        retention = Retention.NONE if is_known else keep
        CommandReport(request, self._reporting, is_repeat=is_known, retention=retention).reject(error.reason)

    # Taking

    def _take(self, request: CommandRequest) -> None:
        """Take a command that is not known yet; refuse one that cannot even begin."""
        try:
            self._demand_open(request.verb)
            begin = self._judged(request, self.starters[request.starter])
        except CommandError as refusal:
            # Without the ledger, what it has may say something else.
            is_stored = refusal.code != ResultCode.NOT_STORED
            self._refuse(request, refusal, Retention.DISK if is_stored else Retention.RUN)
            return
        report = CommandReport(request, self._reporting)
        report.accept()
        begin(report)

    def _judged(self, request: CommandRequest, starter: StarterTelemetry) -> Callable[[CommandReport], None]:
        """Return what carries a command out once it is accepted; CommandError when it cannot even begin."""
        if request.verb in OWN_VERBS:
            return partial(self.under_way.do, self._own_verbs.judge(request, starter))
        preparation = self._prepared(request, starter)
        guard = self.admission.guard(request, starter)
        reads = reading.with_rows(starter.profile, preparation.reads, guard.codes)
        return partial(self.under_way.begin, replace(preparation, reads=reads), guard)

    def _prepared(self, request: CommandRequest, starter: StarterTelemetry) -> Preparation:
        """Return what is to be read and done; CommandError where the starter is not free for this command."""
        preparation = self.admission.check_target(request, starter)
        self.under_way.demand_free(request.starter)
        return preparation

    def _take_stop(self, request: CommandRequest, earlier: LedgerEntry | None) -> None:
        """Stop a starter, or all members of a group that this client may stop; answer what can be.

        `earlier`: the same stop under the same id. While that is under way, its end is the answer.
        """
        names, is_shared = self.admission.stoppable(request), False
        if not self.under_way.is_closing:
            # Before anything is published: that takes longer than the line's silence.
            for name in names:
                self.admission.note_stop(name, request.received_s)
                is_shared |= self.under_way.stop(name)
            self.on_stop()
        if earlier is not None and not earlier.result.phase.is_final:
            if self._overload.admits(request):
                self._repeat(request, earlier)
        elif self.under_way.is_closing:
            self._refuse(request, CommandError(ResultCode.SHUTTING_DOWN))
        elif is_shared:
            self._overload.answer(request, is_stopped=True)
        else:
            is_repeat = earlier is not None
            report = CommandReport(request, self._reporting, is_repeat=is_repeat, retention=Retention.BEHIND)
            self._join(report, names)

    def _join(self, report: CommandReport, stopped: Collection[str]) -> None:
        """Have a stop answered whose frames are asked for; of a group with an answer for each member too."""
        report.accept()
        if report.request.starter in self.starters:
            self.under_way.join(report)
            return
        members = self.admission.members(report.request)
        for member in map(GroupReport(report, members).member, members):
            if member.request.starter in stopped:
                member.accept()
                self.under_way.join(member)
            else:
                member.reject(self.admission.no_right(member.request).reason)


async def _followed(came: asyncio.Queue[ResultRecord]) -> Results:
    is_over = False
    while not is_over:
        result = await came.get()
        is_over = result.phase.is_final
        yield result
