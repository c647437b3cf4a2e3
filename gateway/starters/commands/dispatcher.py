"""Judges commands and has them carried out: one at a time for each starter, stops at once."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Collection, Coroutine, Iterable, Mapping
from contextlib import suppress
from math import inf
from typing import Any, TypeVar

from gateway.contract import (
    LOCK,
    OWN_VERBS,
    READ,
    SELECT,
    STOP,
    CommandError,
    CommandRequest,
    Phase,
    Reason,
    RecordWriter,
    ResultCode,
    ResultRecord,
)
from gateway.starters.commands.admission import (
    CAN_WAIT,
    Admission,
    Load,
    OverloadRefusals,
    no_right,
)
from gateway.starters.commands.execution import CommandExecution
from gateway.starters.commands.group_stop import GroupStop
from gateway.starters.commands.ledger import PROVABLE_S, Ledger, as_repetition, is_same
from gateway.starters.commands.lifecycle import CommandReport, Final, Reporting, audit
from gateway.starters.commands.local_verbs import LocalVerbs, SetBaseline, no_history, target_of
from gateway.starters.commands.recovery import Recovery
from gateway.starters.commands.stop import Stopping
from gateway.starters.policy.freshness import BY_TOKEN, MAX_AHEAD_S
from gateway.starters.policy.policy import Policy
from gateway.starters.policy.preconditions import is_forbidden
from gateway.starters.policy.rights import Rights
from gateway.starters.policy.start_rules import PolicySettings, RateLimiter
from gateway.starters.view import StarterControlView
from gateway.store import Journal, NoJournal, Remembered

logger = logging.getLogger(__name__)

AT_ONCE = 4  # commands of a line that have not yet done their first write: all at once would all expire
_Work = TypeVar("_Work", CommandExecution, Stopping)
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
        starters: Mapping[str, StarterControlView],
        *,
        rights: Rights,
        records: RecordWriter,
        journal: Journal | None = None,
        policy: Policy | None = None,
        stood_still_s: Callable[[], float] = lambda: -inf,
        provable_s: float = PROVABLE_S,
        set_baseline: SetBaseline = no_history,
        on_stop: Callable[[], None] = lambda: None,
    ) -> None:
        self._starters = starters
        self._clock = clock = records.clock
        self._rights = rights
        self._journal = journal or NoJournal()
        self._ledger = Ledger(provable_s=provable_s, on_forgotten=self._journal.forget)
        self._policy = policy or Policy(PolicySettings(), starters.keys(), rights=rights, records=records)
        self._reporting = Reporting(
            records=records,
            ledger=self._ledger,
            write_budget=self._policy.write_budget,
            journal=self._journal,
            stood_still_s=stood_still_s,
        )
        self._groups = self._policy.settings.groups
        self._admission = Admission(
            starters, rights, policy=self._policy, journal=self._journal, ledger=self._ledger, clock=clock
        )
        self._local_verbs = LocalVerbs(self._admission, self._policy, clock=clock, set_baseline=set_baseline)
        self._rate_limiter = RateLimiter(self._policy.settings.limits)
        self._overload_refusals = OverloadRefusals(self._reporting)
        self._executions: dict[str, CommandExecution] = {}
        self._stopped_s: dict[str, float] = {}  # by starter: when its latest stop came
        self._on_stop = on_stop  # called once a stop's frames are asked for
        self._gates: dict[tuple[str, bool], asyncio.Semaphore] = {}  # by line, and whether they can wait
        self._stops: dict[str, Stopping] = {}
        self._recoveries: list[Recovery] = []
        self._tasks: set[asyncio.Task[None]] = set()
        self._is_closing = False
        self._leaving: Collection[str] = ()  # starters whose configuration is about to change

    def submit(self, request: CommandRequest) -> None:
        """Judge a command at once; carry an accepted one out in a task of its own."""
        error = _error_of(self._admission.check_sender, request)
        is_stop = error is None and request.verb == STOP  # never limited
        if not is_stop and not self._admits(request):
            self._overload_refusals.refuse(self._key(request), request)
            return
        earlier = self._ledger.find(request.client, request.id)
        is_repeat = earlier is not None and is_same(request, earlier)
        if error is not None and not is_repeat:
            self._refuse(request, error, is_stored=False)
            return
        if earlier is not None and (not is_stop or (is_repeat and not earlier.phase.is_final)):
            if is_stop:
                self._stop_once_more(self._stoppable(request), request.received_s)
            if not is_stop or self._admits(request):  # a stop under way is answered in any case
                self._repeat(request, earlier)
            return
        try:
            self._demand_open()
            if is_stop:
                self._take_stop(request, is_repeat=is_repeat)
            else:
                self._take(request)
        except CommandError as refusal:
            self._refuse(request, refusal, is_stored=refusal.code not in NOT_TAKEN)

    def reject(self, request: CommandRequest, error: CommandError) -> None:
        """Reject a command that is not fit to be submitted; a repetition gets the first one's result."""
        if not self._admits(request):
            self._overload_refusals.refuse(self._key(request), request)
            return
        earlier = self._ledger.find(request.client, request.id)
        if earlier is not None and is_same(request, earlier):
            self._repeat(request, earlier)
        else:
            self._refuse(request, error, is_stored=False)

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
        self._overload_refusals.refuse(self._key(request), request)

    def recall(self, commands: Iterable[Remembered]) -> None:
        """Record the commands of earlier runs, the oldest first; publish once what was cut short."""
        for remembered in commands:
            result = remembered.result
            known = self._ledger.find(result.client, result.id)
            if known is not None and known.phase is not Phase.REJECTED:
                continue  # a stop that came before the ledger could be read; all else was refused
            if not result.phase.is_final:
                starter = self._starters.get(result.starter)
                recovery = Recovery(remembered, starter, self._reporting)
                result = recovery.result()
                self._recoveries.append(recovery)
                self._spawn(recovery.publish())
            self._ledger.store(result, now_s=self._clock.now_s())  # its age begins now: no clock says it

    async def settle(self, starters: Collection[str], *, within_s: float) -> None:
        """Wait until these starters are under no command; they take none but stop until `apply_rights`."""
        self._leaving = starters
        with suppress(TimeoutError):
            async with asyncio.timeout(within_s):
                while any(name in self._executions or name in self._stops for name in starters):
                    await asyncio.wait(self._tasks, return_when=asyncio.FIRST_COMPLETED)

    def stopped_s(self) -> float:
        """Return when the latest stop of any starter came, on the steady clock."""
        return max(self._stopped_s.values(), default=-inf)

    def freshness(self, client: str, *, verb: str, starter: str) -> tuple[str, ...]:
        """Return the settings that say what may prove such a command fresh."""
        return self._rights.freshness(client, verb=verb, starter=starter)

    def apply_rights(self, rights: Rights) -> None:
        """Judge new commands by these rights and the policy's present settings from now on."""
        self._rights = rights
        self._groups = self._policy.settings.groups
        self._admission.apply_rights(rights)
        self._leaving = ()

    async def close(self) -> None:
        """Write nothing more: end every command, rejected or unconfirmed, and take no new one."""
        self._is_closing = True
        for execution in self._executions.values():
            execution.halt(Reason(ResultCode.SHUTTING_DOWN))
        for stopping in self._stops.values():
            stopping.halt(Reason(ResultCode.SHUTTING_DOWN))
        for recovery in self._recoveries:
            recovery.hurry()
        if self._tasks:
            await asyncio.wait(self._tasks)
        self._overload_refusals.close()

    def _preview(self, request: CommandRequest) -> None:
        self._admission.check_sender(request)
        self._demand_open()
        starter = self._starters.get(request.starter)
        if request.verb == STOP or starter is None:
            return
        if request.verb in OWN_VERBS:
            self._local_verbs.check(request, starter)
        else:
            self._admission.preview(request, starter, self._load(request))

    def _demand_open(self) -> None:
        if self._is_closing:
            raise CommandError(ResultCode.SHUTTING_DOWN)

    def _key(self, request: CommandRequest) -> str:
        """Return whose limits a command counts against: clients without any right share theirs."""
        return request.client if self._rights.is_known(request.client) else ""

    def _admits(self, request: CommandRequest) -> bool:
        starter = request.starter if request.starter in self._starters else ""
        return self._rate_limiter.admits(
            client=self._key(request), starter=starter, now_s=self._clock.now_s()
        )

    def _repeat(self, request: CommandRequest, earlier: ResultRecord) -> None:
        """Send the stored result of a command again; an id that stood for another command is refused."""
        if not is_same(request, earlier):
            error = CommandError(ResultCode.ID_REUSED, verb=earlier.verb, starter=earlier.starter)
            self._refuse(request, error, is_stored=False)
            return
        self._reporting.records.put(as_repetition(earlier, request))
        audit(request, self._reporting.records, decision="duplicate", code=earlier.code)

    def _refuse(self, request: CommandRequest, error: CommandError, *, is_stored: bool) -> None:
        """Refuse a command; under an id that has a result, as a duplicate: that result stays."""
        is_known = self._ledger.find(request.client, request.id) is not None
        report = CommandReport(request, self._reporting, is_repeat=is_known)
        end = Final(Phase.REJECTED, error.reason)
        if is_known or is_stored or error.code in UNFIT:
            report.finish(end, is_stored=is_stored and not is_known)
        else:
            report.refuse(end)

    def _take(self, request: CommandRequest) -> None:
        """Carry out a command other than a stop; CommandError when it cannot even begin."""
        starter = self._starters[request.starter]
        if request.verb in OWN_VERBS:
            self._local_verbs.check(request, starter)
            if request.verb == SELECT:
                self._demand_decided_after_stop(target_of(request))
            report = CommandReport(request, self._reporting)
            report.accept()
            keeping = self._local_verbs.act(report, starter)
            if request.verb == LOCK:
                self._cut_for_lock(request.starter)
            if keeping is not None:
                self._spawn(keeping)
            return
        if request.starter not in self._stops:  # else it is refused as busy
            self._demand_decided_after_stop(request)
        load = self._load(request)
        preparation, guard = self._admission.check(request, starter, load)
        report = CommandReport(request, self._reporting)
        report.accept()
        key = (starter.setup.line, request.verb in CAN_WAIT)  # the two do not wait for each other
        gate = self._gates.setdefault(key, asyncio.Semaphore(AT_ONCE))
        self._executions[request.starter] = CommandExecution(
            report,
            starter,
            preparation,
            guard,
            None if request.verb == READ else gate,
            self._policy.watchdogs,
        )
        self._spawn(_run_out(self._executions, request.starter))

    def _demand_decided_after_stop(self, request: CommandRequest) -> None:
        """Refuse what came before the latest stop of its starter; what may move the motor also when it
        came later, but may have been decided upon before.
        """
        stopped_s = self._stopped_s.get(request.starter, -inf)
        if request.received_s <= stopped_s:
            raise CommandError(ResultCode.STOPPED_FIRST, "overtaken")
        if request.verb in CAN_WAIT or not is_forbidden(request.verb, request.args):
            return
        if request.decided_s is not None and request.decided_s < stopped_s:
            if request.decided_by == BY_TOKEN:
                raise CommandError(ResultCode.STOPPED_FIRST, "token")
            raise CommandError(ResultCode.STOPPED_FIRST, "issued_at", ahead_s=MAX_AHEAD_S)

    def _take_stop(self, request: CommandRequest, *, is_repeat: bool) -> None:
        """Stop a starter, or all members of a group that this client may stop; answer what can be."""
        members, names = self._members(request), self._stoppable(request)
        under_way = [self._stops[name] for name in names if name in self._stops]
        is_asked_for = all(each.is_asked_for(request) for each in under_way) and len(under_way) == len(names)
        is_full = any(each.count >= self._policy.settings.limits.answered_stops for each in under_way)
        for name in names:
            # Before anything is published: that takes longer than the line's silence.
            self._begin_stop(name, request.received_s).ask()
        self._on_stop()
        if is_asked_for:
            return
        if is_full:
            self._overload_refusals.answer_untracked_stop(self._key(request), request)
            return
        report = CommandReport(request, self._reporting, is_repeat=is_repeat)
        report.accept()
        if request.starter not in self._groups:
            self._stops[request.starter].join(report)
            return
        whole = GroupStop(report, members, self._reporting)
        for name in members:
            member = whole.member(name)
            if name in names:
                member.accept()
                self._stops[name].join(member)
            else:
                member.finish(Final(Phase.REJECTED, no_right(member.request).reason))

    def _begin_stop(self, name: str, came_s: float) -> Stopping:
        """Cut what this starter is doing, then stop it, unless that is under way."""
        self._stopped_s[name] = max(came_s, self._stopped_s.get(name, -inf))
        self._policy.selections.end(name)  # what was decided upon before the stop is decided anew
        execution = self._executions.get(name)
        if execution is not None:
            execution.halt(Reason(ResultCode.STOPPED_FIRST, "cut"))
        stopping = self._stops.get(name)
        if stopping is None:
            stopping = self._stops[name] = Stopping(self._starters[name])
            self._spawn(_run_out(self._stops, name))
        return stopping

    def _stop_once_more(self, names: Iterable[str], came_s: float) -> None:
        """Send a frame to each of these for a stop message that gets no life of its own."""
        if self._is_closing:
            return
        for name in names:
            self._begin_stop(name, came_s).ask()
        self._on_stop()

    def _members(self, request: CommandRequest) -> Collection[str]:
        return self._groups.get(request.starter, (request.starter,))

    def _stoppable(self, request: CommandRequest) -> list[str]:
        """Return the starters that a stop is for and its client may stop."""
        members = self._members(request)
        return [name for name in members if self._admission.may_stop(request.client, name)]

    def _load(self, request: CommandRequest) -> Load:
        name, line = request.starter, self._starters[request.starter].setup.line
        on_line = [each for each in self._executions.values() if each.line == line]
        return Load(
            is_busy=name in self._executions or name in self._stops,
            is_leaving=name in self._leaving,
            on_line=len(on_line),
            parameters_on_line=sum(each.can_wait for each in on_line),
        )

    def _cut_for_lock(self, name: str) -> None:
        """Let a command that the lock forbids not be written any more; what is written is still read back."""
        execution = self._executions.get(name)
        if execution is None or execution.report.life.is_written:
            return
        if is_forbidden(execution.report.request.verb, execution.report.request.args):
            execution.halt(Reason(ResultCode.LOCKED, "cut"))

    def _spawn(self, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.get_running_loop().create_task(work)
        self._tasks.add(task)  # the loop itself keeps only a weak reference
        task.add_done_callback(self._tasks.discard)


async def _run_out(under_way: dict[str, _Work], name: str) -> None:
    """Run what is under way for a starter to its end."""
    try:
        await under_way[name].run()
    finally:
        del under_way[name]


def _error_of(check: Callable[..., None], *args: Any) -> CommandError | None:
    """Return the CommandError that a check raises; None when it raises none."""
    try:
        check(*args)
    except CommandError as error:
        return error
    return None
