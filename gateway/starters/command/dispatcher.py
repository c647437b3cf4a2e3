"""Judges commands and has them carried out: one at a time for each starter, stops at once."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import replace
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
from gateway.starters.command.admission import Admission
from gateway.starters.command.ledger import PROVABLE_S, Ledger, as_repetition, is_same
from gateway.starters.command.overload import Overload
from gateway.starters.command.own_verbs import OwnVerbs, SetBaseline, no_history, target_of
from gateway.starters.command.report import CommandReport, Final, Reporting, Retention
from gateway.starters.command.run.ends import crashed
from gateway.starters.command.stop.group import GroupStop
from gateway.starters.command.under_way import UnderWay
from gateway.starters.policy.policy import Policy
from gateway.starters.policy.rights import Rights
from gateway.starters.policy.start_rules import PolicySettings
from gateway.starters.view import StarterIo
from gateway.store import Journal, Remembered

NOT_TAKEN = (  # without the ledger, what it has may say something else
    ResultCode.LEDGER_UNAVAILABLE,
    ResultCode.LEDGER_FULL,
    ResultCode.TOO_MANY,
)
UNFIT = (  # of what is refused however often it comes: its id is free for a fit command
    ResultCode.BAD_JSON,
    ResultCode.BAD_PAYLOAD,
    ResultCode.BEFORE_CONNECTION,
    ResultCode.EXPIRED,
    ResultCode.MALFORMED_TOPIC,
    ResultCode.NO_ID,
    ResultCode.RETAINED,
    ResultCode.TOO_BIG,
    ResultCode.UNKNOWN_VERB,
)


class Dispatcher:
    """Takes commands for all starters, on the app's loop; every command gets exactly one final result."""

    def __init__(
        self,
        starters: Mapping[str, StarterIo],
        *,
        rights: Rights,
        records: RecordWriter,
        journal: Journal,
        policy: Policy | None = None,
        stood_still_s: Callable[[], float] = lambda: -inf,
        provable_s: float = PROVABLE_S,
        set_baseline: SetBaseline = no_history,
        on_stop: Callable[[], None] = lambda: None,
    ) -> None:
        self._starters = starters
        self._policy = policy or Policy(PolicySettings(), starters.keys(), rights=rights, records=records)
        self._reporting = Reporting(
            records=records,
            ledger=Ledger(provable_s=provable_s, on_forgotten=journal.forget),
            write_budget=self._policy.write_budget,
            journal=journal,
            stood_still_s=stood_still_s,
        )
        self._under_way = UnderWay(starters, self._reporting, self._policy)
        self._admission = Admission(starters, rights, policy=self._policy, reporting=self._reporting)
        self._own_verbs = OwnVerbs(
            self._admission, self._policy, clock=records.clock, set_baseline=set_baseline
        )
        self._overload = Overload(self._policy.settings.limits, self._reporting)
        self._on_stop = on_stop  # called once a stop's frames are asked for
        self._is_closing = False

    def submit(self, request: CommandRequest, refusal: CommandError | None = None) -> None:
        """Judge a command at once; carry an accepted one out in a task of its own.

        One that comes with a refusal is only answered: with that, or its repetition with its first result.
        """
        error = refusal or _error_of(self._admission.check_sender, request)
        is_stop = error is None and request.verb == STOP  # never limited
        if not is_stop and not self._admits(request):
            self._overload.answer(self._key(request), request)
            return
        earlier = self._reporting.known(request)
        is_repeat = earlier is not None and is_same(request, earlier)
        if error is not None and not is_repeat:
            self._refuse(request, error, is_stored=False)
        elif earlier is not None and (not is_stop or (is_repeat and not earlier.phase.is_final)):
            if is_stop and not self._is_closing:
                self._stop_all(self._stoppable(request), request.received_s)
            if not is_stop or self._admits(request):  # a stop under way is answered in any case
                self._repeat(request, earlier)
        else:
            self._carry_out(request, is_repeat=is_repeat)

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
        ledger, clock = self._reporting.ledger, self._reporting.records.clock
        for remembered in commands:
            result = remembered.result
            known = ledger.find(result.client, result.id)
            if known is not None and known.phase is not Phase.REJECTED:
                continue  # a stop that came before the ledger could be read; all else was refused
            if not result.phase.is_final:
                end = crashed(result.verb, may_be_written=remembered.may_be_written)
                result = replace(result, phase=end.phase, code=end.code, text=end.text, values={})
                result = replace(result, time_s=clock.utc_s())
                self._publish_crashed(result)
            ledger.store(result, now_s=clock.now_s())  # its age begins now: no clock says it

    def _publish_crashed(self, result: ResultRecord) -> None:
        """Publish the end of a command of an earlier run, and an event where something may be written."""
        reporting, starter = self._reporting, self._starters.get(result.starter)
        reporting.journal.note(result, then=lambda: reporting.records.put(result))
        request = CommandRequest(result.starter, result.client, result.verb, result.id)
        reporting.audit(request, result.phase, result.code)
        if starter is not None and result.phase is Phase.UNCONFIRMED:
            starter.emitter.event(
                EventCode.COMMAND_CUT_SHORT,
                client=result.client,
                id=result.id,
                verb=result.verb,
                outcome=result.text,
            )

    async def settle(self, starters: Collection[str], *, within_s: float) -> None:
        """Wait until these starters are under no command; they take none but stop until `apply_rights`."""
        await self._under_way.settle(starters, within_s=within_s)

    def stopped_s(self) -> float:
        """Return when the latest stop of any starter came, on the steady clock."""
        return self._under_way.stopped_s()

    def freshness(self, request: CommandRequest) -> tuple[str, ...]:
        """Return the settings that say what may prove such a command fresh."""
        return self._admission.rights.freshness(request.client, verb=request.verb, starter=request.starter)

    def apply_rights(self, rights: Rights) -> None:
        """Judge new commands by these rights and the policy's present settings from now on."""
        self._admission.rights = rights
        self._under_way.reopen()

    async def close(self) -> None:
        """Write nothing more: end every command, rejected or unconfirmed, and take no new one."""
        self._is_closing = True
        await self._under_way.close()
        self._overload.close()

    # Judging

    def _preview(self, request: CommandRequest) -> None:
        self._admission.check_sender(request)
        self._demand_open()
        starter = self._starters.get(request.starter)
        if request.verb == STOP or starter is None:
            return
        if request.verb in OWN_VERBS:
            self._own_verbs.check(request, starter)
        else:
            self._admission.preview(request, starter, self._under_way.demand_free)

    def _demand_open(self) -> None:
        if self._is_closing:
            raise CommandError(ResultCode.SHUTTING_DOWN)

    def _key(self, request: CommandRequest) -> str:
        """Return whose limits a command counts against: clients without any right share theirs."""
        return request.client if self._admission.rights.is_known(request.client) else ""

    def _admits(self, request: CommandRequest) -> bool:
        starter = request.starter if request.starter in self._starters else ""
        return self._overload.admits(self._key(request), starter)

    def _repeat(self, request: CommandRequest, earlier: ResultRecord) -> None:
        """Send the stored result of a command again; an id that stood for another command is refused."""
        if not is_same(request, earlier):
            error = CommandError(ResultCode.ID_REUSED, verb=earlier.verb, starter=earlier.starter)
            self._refuse(request, error, is_stored=False)
            return
        is_published = self._reporting.ledger.is_published(request.client, request.id)
        if is_published:  # else the answer of the first is still to come
            self._reporting.records.put(as_repetition(earlier, request))
        self._reporting.audit(request, "duplicate", earlier.code)

    def _refuse(self, request: CommandRequest, error: CommandError, *, is_stored: bool) -> None:
        """Refuse a command; under an id that has a result, as a duplicate: that result stays.

        A refused id stays so, else a copy could be carried out after its client has read the refusal.
        """
        is_known = self._reporting.known(request) is not None
        retention = Retention.DISK if is_stored else Retention.NONE if error.code in UNFIT else Retention.RUN
        retention = Retention.NONE if is_known else retention
        report = CommandReport(request, self._reporting, is_repeat=is_known, retention=retention)
        report.finish(Final(Phase.REJECTED, error.reason))

    # Taking

    def _carry_out(self, request: CommandRequest, *, is_repeat: bool) -> None:
        """Take a command that is not known yet, or a stop."""
        try:
            self._demand_open()
            if request.verb == STOP:
                self._take_stop(request, is_repeat=is_repeat)
            elif request.verb in OWN_VERBS:
                self._take_own(request)
            else:
                self._take(request)
        except CommandError as refusal:
            self._refuse(request, refusal, is_stored=refusal.code not in NOT_TAKEN)

    def _take(self, request: CommandRequest) -> None:
        """Carry out a command of a starter's family; CommandError when it cannot even begin."""
        if not self._under_way.is_busy(request.starter):  # else it is refused for that
            self._under_way.demand_decided_after_stop(request)
        starter = self._starters[request.starter]
        preparation, guard = self._admission.check(request, starter, self._under_way.demand_free)
        report = CommandReport(request, self._reporting)
        report.accept()
        self._under_way.begin(report, preparation, guard)

    def _take_own(self, request: CommandRequest) -> None:
        """Carry out one of the gateway's own verbs; CommandError when it must not be."""
        starter = self._starters[request.starter]
        self._own_verbs.check(request, starter)
        if request.verb == SELECT:
            self._under_way.demand_decided_after_stop(target_of(request))
        report = CommandReport(request, self._reporting)
        report.accept()
        rest = self._own_verbs.act(report, starter)
        if request.verb == LOCK:
            self._under_way.cut_for_lock(request.starter)
        if rest is not None:
            self._under_way.spawn(rest)

    def _take_stop(self, request: CommandRequest, *, is_repeat: bool) -> None:
        """Stop a starter, or all members of a group that this client may stop; answer what can be."""
        names = self._stoppable(request)
        most = self._policy.settings.limits.answered_stops
        is_full = any(stopping.count >= most for stopping in self._under_way.stops(names))
        # Before anything is published: that takes longer than the line's silence.
        self._stop_all(names, request.received_s)
        if is_full:
            self._overload.answer(self._key(request), request, is_stopped=True)
            return
        report = CommandReport(request, self._reporting, is_repeat=is_repeat)
        report.accept()
        if request.starter in self._starters:
            self._under_way.join(request.starter, report)
            return
        members = self._members(request)
        whole = GroupStop(report, members)
        for name in members:
            member = whole.member(name)
            if name in names:
                member.accept()
                self._under_way.join(name, member)
            else:
                member.finish(Final(Phase.REJECTED, self._admission.no_right(member.request).reason))

    def _stop_all(self, names: Iterable[str], came_s: float) -> None:
        for name in names:
            self._policy.selections.end(name)  # what was decided upon before the stop is decided again
            self._under_way.stop(name, came_s)
        self._on_stop()

    def _members(self, request: CommandRequest) -> Collection[str]:
        return self._policy.settings.groups.get(request.starter, (request.starter,))

    def _stoppable(self, request: CommandRequest) -> list[str]:
        """Return the starters that a stop is for and its client may stop."""
        members = self._members(request)
        return [name for name in members if self._admission.may_stop(request.client, name)]


def _error_of(check: Callable[..., None], *args: Any) -> CommandError | None:
    """Return the CommandError that a check raises; None when it raises none."""
    try:
        check(*args)
    except CommandError as error:
        return error
    return None
