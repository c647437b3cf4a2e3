"""Judges commands and has them carried out: one at a time for each starter, stops at once."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Collection, Coroutine, Iterable, Mapping
from contextlib import suppress
from math import inf
from typing import Any

from gateway.errors import CommandError
from gateway.records import LOCK, OWN_VERBS, READ, Phase, ResultRecord, SequenceNumbers, Sink
from gateway.starters.commands.admission import (
    CAN_WAIT,
    LEDGER_FULL,
    TOO_MANY,
    Admission,
    Load,
    OverloadRefusals,
)
from gateway.starters.commands.command_queue import CommandQueue
from gateway.starters.commands.execution import HALTED, CommandExecution
from gateway.starters.commands.ledger import Ledger, Proofs, is_same, told_again
from gateway.starters.commands.lifecycle import STOP, CommandReport, Final, Reporting, audit
from gateway.starters.commands.local_verbs import LocalVerbs
from gateway.starters.commands.recovery import Recovery
from gateway.starters.commands.stop import GroupStop, Stopping
from gateway.starters.commands.view import StarterControlView
from gateway.starters.policy.lock import is_forbidden
from gateway.starters.policy.policy import Policy
from gateway.starters.policy.request import CommandRequest, Refusable, request_of
from gateway.starters.policy.rights import Rights
from gateway.starters.policy.start_rules import PolicySettings, RateLimiter
from gateway.storage.journal import UNAVAILABLE, Journal, NoJournal, Remembered
from gateway.system.clock import Clock

logger = logging.getLogger(__name__)

SAVED_WITHIN_S = 1.0  # at the end
NOT_TAKEN = (UNAVAILABLE, LEDGER_FULL, TOO_MANY)  # without the ledger, what it has may say something else
UNFIT = frozenset(  # codes of what is refused however often it comes: its id is free for a fit command
    {
        "bad_json",
        "bad_payload",
        "before_connection",
        "expired",
        "malformed_topic",
        "no_id",
        "retained",
        "too_big",
        "unknown_verb",
    }
)


class Dispatcher:
    """Takes commands for all starters, on the app's loop; every command gets exactly one final result."""

    def __init__(
        self,
        starters: Mapping[str, StarterControlView],
        *,
        rights: Rights,
        sink: Sink,
        clock: Clock,
        sequence: SequenceNumbers,
        journal: Journal | None = None,
        precautions: Policy | None = None,
        stood_still_s: Callable[[], float] = lambda: -inf,
        proofs: Proofs | None = None,
    ) -> None:
        self._starters = starters
        self._rights = rights
        self._journal = journal or NoJournal()
        self._ledger = Ledger(proofs=proofs, on_forgotten=self._journal.forget)
        self._precautions = precautions or Policy(
            PolicySettings(), starters.keys(), rights=rights, sink=sink, clock=clock, sequence=sequence
        )
        self._desk = Reporting(
            sink=sink,
            clock=clock,
            sequence=sequence,
            ledger=self._ledger,
            wear=self._precautions.wear,
            journal=self._journal,
            stood_still_s=stood_still_s,
        )
        self._groups = self._precautions.policy.groups
        self._admission = Admission(
            starters,
            rights=rights,
            precautions=self._precautions,
            journal=self._journal,
            ledger=self._ledger,
            clock=clock,
        )
        self._administration = LocalVerbs(self._admission, self._precautions, clock=clock)
        self._flood = RateLimiter(self._precautions.policy.limits)
        self._excess = OverloadRefusals(self._desk)
        self._conducts: dict[str, CommandExecution] = {}
        self._stopped_s: dict[str, float] = {}  # by starter: when its latest stop came
        self._queues: dict[tuple[str, bool], CommandQueue] = {}  # by line, and whether they can wait
        self._stops: dict[str, Stopping] = {}
        self._aftermaths: list[Recovery] = []
        self._tasks: set[asyncio.Task[None]] = set()
        self._is_closing = False
        self._leaving: Collection[str] = ()  # starters whose configuration is about to change

    def submit(self, request: CommandRequest) -> None:
        """Judge a command at once; carry an accepted one out in a task of its own."""
        error = self._sender_error(request)
        is_stop = error is None and request.verb == STOP  # never limited
        if not is_stop and not self._admits(request):
            self._excess.refuse(self._key(request), request, "too many commands at once; send fewer")
            return
        earlier = self._ledger.find(request.client, request.id)
        is_repeat = earlier is not None and is_same(request, earlier)
        if error is not None and not is_repeat:
            self._refuse(request, error, is_kept=False)
            return
        if earlier is not None and (not is_stop or (is_repeat and not earlier.phase.is_final)):
            if is_stop:
                self._stop_once_more(self._stoppable(request), request.received_s)
            if not is_stop or self._admits(request):  # a stop under way is answered in any case
                self._repeat(request, earlier)
            return
        try:
            if self._is_closing:
                raise CommandError("shutting_down", HALTED["shutting_down"])  # noqa: TRY301 - as for the others
            if is_stop:
                self._take_stop(request, is_repeat=is_repeat)
            else:
                self._take(request)
        except CommandError as refusal:
            self._refuse(request, refusal, is_kept=refusal.code not in NOT_TAKEN)

    def reject(self, refusable: Refusable, code: str, text: str) -> None:
        """Reject a command that is not fit to be submitted; a repetition gets the first one's result."""
        request = request_of(refusable)
        if not self._admits(request):
            self._excess.refuse(self._key(request), request, "too many commands at once; send fewer")
            return
        earlier = self._ledger.find(request.client, request.id)
        if earlier is not None and is_same(request, earlier):
            self._repeat(request, earlier)
        else:
            self._refuse(request, CommandError(code, text), is_kept=False)

    def verb_error(self, starter: str, verb: str) -> CommandError | None:
        """Return what is wrong with a verb for a starter; None when nothing is."""
        try:
            self._admission.check_verb(starter, verb)
        except CommandError as error:
            return error
        return None

    def refuse_unread(self, starter: str, client: str, verb: str) -> None:
        """Refuse a command that is one too many, of which only the topic was read."""
        request = CommandRequest(starter, client, verb)
        self._excess.refuse(self._key(request), request, "too many commands at once; send fewer")

    def recall(self, commands: Iterable[Remembered]) -> None:
        """Take over the commands of earlier runs, the oldest first; say once what was cut short."""
        for remembered in commands:
            result = remembered.result
            known = self._ledger.find(result.client, result.id)
            if known is not None and known.phase is not Phase.REJECTED:
                continue  # a stop that came before the ledger could be read; all else was refused
            if not result.phase.is_final:
                starter = self._starters.get(result.starter)
                aftermath = Recovery(remembered, starter, self._desk)
                result = aftermath.result()
                self._aftermaths.append(aftermath)
                self._spawn(aftermath.tell())
            self._ledger.store(result, now_s=self._desk.clock.now_s())  # its age begins now: no clock says it

    async def settle(self, starters: Collection[str], *, within_s: float) -> None:
        """Wait until these starters are under no command; until `take_over` they take no new one but stop."""
        self._leaving = starters
        with suppress(TimeoutError):
            async with asyncio.timeout(within_s):
                while any(name in self._conducts or name in self._stops for name in starters):
                    await asyncio.wait(self._tasks, return_when=asyncio.FIRST_COMPLETED)

    def freshness(self, client: str, *, verb: str, starter: str) -> tuple[str, ...]:
        """Return the settings that say what may prove such a command fresh."""
        return self._rights.freshness(client, verb=verb, starter=starter)

    def take_over(self, rights: Rights) -> None:
        """Judge new commands by these rights and the precautions' present policy from now on."""
        self._rights = rights
        self._groups = self._precautions.policy.groups
        self._admission.take_over(rights)
        self._leaving = ()

    async def close(self) -> None:
        """Write nothing more: end every command, rejected or unconfirmed, and take no new one."""
        self._is_closing = True
        for conduct in self._conducts.values():
            conduct.halt("shutting_down")
        for stopping in self._stops.values():
            stopping.halt("shutting_down")
        for aftermath in self._aftermaths:
            aftermath.hurry()
        if self._tasks:
            await asyncio.wait(self._tasks)
        self._excess.close()
        await self._precautions.saver.close(within_s=SAVED_WITHIN_S)

    def _sender_error(self, request: CommandRequest) -> CommandError | None:
        try:
            self._admission.check_sender(request)
        except CommandError as error:
            return error
        return None

    def _key(self, request: CommandRequest) -> str:
        """Return whose limits a command counts against: clients without any right share theirs."""
        return request.client if self._rights.is_known(request.client) else ""

    def _admits(self, request: CommandRequest) -> bool:
        starter = request.starter if request.starter in self._starters else ""
        return self._flood.admits(client=self._key(request), starter=starter, now_s=self._desk.clock.now_s())

    def _repeat(self, request: CommandRequest, earlier: ResultRecord) -> None:
        """Send the stored result of a command again; an id that stood for another command is refused."""
        if not is_same(request, earlier):
            text = f"this id was used for {earlier.verb} of {earlier.starter}"
            self._refuse(request, CommandError("id_reused", text), is_kept=False)
            return
        self._desk.sink.put(told_again(earlier, request))
        audit(request, self._desk, decision="duplicate", code=earlier.code)

    def _refuse(self, request: CommandRequest, error: CommandError, *, is_kept: bool) -> None:
        """Refuse a command; under an id that has a result, as a duplicate: that result stays."""
        is_known = self._ledger.find(request.client, request.id) is not None
        errand = CommandReport(request, self._desk, is_repeat=is_known)
        end = Final(Phase.REJECTED, error.code, error.text)
        if is_known or is_kept or error.code in UNFIT:
            errand.finish(end, is_kept=is_kept and not is_known)
        else:
            errand.refuse(end)

    def _take(self, request: CommandRequest) -> None:
        """Carry out a command other than a stop; CommandError when it cannot even begin."""
        starter = self._starters[request.starter]
        if request.verb in OWN_VERBS:
            self._administration.check(request, starter)
            errand = CommandReport(request, self._desk)
            errand.accept()
            keeping = self._administration.act(errand, starter)
            if request.verb == LOCK:
                self._cut_for_lock(request.starter)
            if keeping is not None:
                self._spawn(keeping)
            return
        stopped_s = self._stopped_s.get(request.starter, -inf)
        if request.received_s <= stopped_s and request.starter not in self._stops:
            raise CommandError("stopped_first", "a stop that came later was taken first")
        load = self._load(request)
        preparation, guard = self._admission.check(request, starter, load)
        errand = CommandReport(request, self._desk)
        errand.accept()
        place = None if request.verb == READ else load.queue.enter(request.expires_s)
        self._conducts[request.starter] = conduct = CommandExecution(
            errand, starter, preparation, guard, place, self._precautions.watchdogs
        )
        self._spawn(self._until_done(request.starter, conduct))

    def _take_stop(self, request: CommandRequest, *, is_repeat: bool) -> None:
        """Stop a starter, or all members of a group that this client may stop; answer what can be."""
        members, names = self._members(request), self._stoppable(request)
        under_way = [self._stops[name] for name in names if name in self._stops]
        is_asked_for = all(each.is_asked_for(request) for each in under_way) and len(under_way) == len(names)
        is_full = any(each.count >= self._precautions.policy.limits.answered_stops for each in under_way)
        for name in names:
            # Before anything is told: that takes longer than the line's silence.
            self._begin_stop(name, request.received_s).ask()
        if is_asked_for:
            return
        if is_full:
            self._excess.pass_over(self._key(request), request)
            return
        errand = CommandReport(request, self._desk, is_repeat=is_repeat)
        errand.accept()
        if request.starter not in self._groups:
            self._stops[request.starter].join(errand)
            return
        whole = GroupStop(errand, members, self._desk)
        for name in members:
            member = whole.member(name)
            if name in names:
                member.accept()
                self._stops[name].join(member)
            else:
                text = f"{request.client} has no right to stop {name}"
                member.finish(Final(Phase.REJECTED, "not_allowed", text))

    def _begin_stop(self, name: str, came_s: float) -> Stopping:
        """Cut what this starter is doing, then stop it, unless that is under way."""
        self._stopped_s[name] = max(came_s, self._stopped_s.get(name, -inf))
        self._precautions.selections.end(name)  # what was decided upon before the stop is decided anew
        conduct = self._conducts.get(name)
        if conduct is not None:
            conduct.halt("stopped_first")
        stopping = self._stops.get(name)
        if stopping is None:
            stopping = self._stops[name] = Stopping(self._starters[name])
            self._spawn(self._until_stopped(name, stopping))
        return stopping

    def _stop_once_more(self, names: Iterable[str], came_s: float) -> None:
        """Send a frame to each of these for a stop message that gets no life of its own."""
        if self._is_closing:
            return
        for name in names:
            self._begin_stop(name, came_s).ask()

    def _members(self, request: CommandRequest) -> Collection[str]:
        return self._groups.get(request.starter, (request.starter,))

    def _stoppable(self, request: CommandRequest) -> list[str]:
        """Return the starters that a stop is for and its client may stop."""
        members = self._members(request)
        return [name for name in members if self._admission.may_stop(request.client, name)]

    def _load(self, request: CommandRequest) -> Load:
        name, line = request.starter, self._starters[request.starter].setup.line
        key = (line, request.verb in CAN_WAIT)  # the two do not wait for each other
        queue = self._queues.setdefault(key, CommandQueue(self._desk.clock.now_s))
        on_line = [each for each in self._conducts.values() if each.line == line]
        return Load(
            is_busy=name in self._conducts or name in self._stops,
            is_leaving=name in self._leaving,
            on_line=len(on_line),
            parameters_on_line=sum(each.can_wait for each in on_line),
            queue=queue,
        )

    def _cut_for_lock(self, name: str) -> None:
        """Let a command that the lock forbids not be written any more; what is written is still read back."""
        conduct = self._conducts.get(name)
        if conduct is None or conduct.errand.life.is_written:
            return
        if is_forbidden(conduct.errand.request.verb, conduct.errand.request.args):
            conduct.halt("locked")

    async def _until_done(self, name: str, conduct: CommandExecution) -> None:
        try:
            await conduct.run()
        finally:
            del self._conducts[name]

    async def _until_stopped(self, name: str, stopping: Stopping) -> None:
        try:
            await stopping.run()
        finally:
            del self._stops[name]

    def _spawn(self, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.get_running_loop().create_task(work)
        self._tasks.add(task)  # the loop itself keeps only a weak reference
        task.add_done_callback(self._tasks.discard)
