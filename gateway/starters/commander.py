"""Judges commands and has them carried out: one at a time for each starter, stops at once."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Coroutine, Iterable, Mapping
from dataclasses import replace
from typing import Any, Protocol

from gateway.clock import Clock
from gateway.errors import CommandError
from gateway.families.command import prepare, verbs
from gateway.families.procedure import Preparation
from gateway.starters.aftermath import Aftermath
from gateway.starters.conduct import HALTED, Conduct
from gateway.starters.control import StarterControlView
from gateway.starters.errand import STOP, Desk, End, Errand, audit
from gateway.starters.identification import Standing
from gateway.starters.journal import UNAVAILABLE, Journal, NoJournal, Remembered
from gateway.starters.ledger import Ledger
from gateway.starters.records import Phase, ResultRecord, Sink
from gateway.starters.request import CommandRequest
from gateway.starters.rights import Rights
from gateway.starters.sequence import Sequence
from gateway.starters.stopping import Stopping

logger = logging.getLogger(__name__)


class Refusable(Protocol):
    """What must be known of a command to tell its client that it is rejected."""

    @property
    def starter(self) -> str:
        """The starter it names."""
        ...

    @property
    def client(self) -> str:
        """Who sent it."""
        ...

    @property
    def verb(self) -> str:
        """What it wants."""
        ...

    @property
    def id(self) -> str | None:
        """Its id, when it has a legible one."""
        ...

    @property
    def args(self) -> Mapping[str, Any]:
        """Its arguments, as far as legible."""
        ...

    @property
    def operator(self) -> str | None:
        """Who it says it is from."""
        ...

    @property
    def correlation(self) -> bytes | None:
        """The MQTT 5 correlation data."""
        ...


class Commander:
    """Takes commands for all starters, on the app's loop; every command gets exactly one final result."""

    def __init__(
        self,
        starters: Mapping[str, StarterControlView],
        *,
        rights: Rights,
        sink: Sink,
        clock: Clock,
        sequence: Sequence,
        journal: Journal | None = None,
    ) -> None:
        self._starters = starters
        self._rights = rights
        self._ledger = Ledger()
        self._journal = journal or NoJournal()
        self._desk = Desk(
            sink=sink, clock=clock, sequence=sequence, ledger=self._ledger, journal=self._journal
        )
        self._conducts: dict[str, Conduct] = {}
        self._stops: dict[str, Stopping] = {}
        self._tasks: set[asyncio.Task[None]] = set()
        self._is_closing = False

    def submit(self, request: CommandRequest) -> None:
        """Judge a command at once; carry an accepted one out in a task of its own."""
        try:
            self._check_sender(request)
        except CommandError as error:
            self._refuse(request, error, is_kept=False)
            return
        earlier = self._ledger.find(request.client, request.id)
        if earlier is not None and not self._is_done_again(request, earlier):
            self._repeat(request, earlier)
            return
        try:
            starter = self._starters[request.starter]
            preparation = self._check(request, starter)
        except CommandError as error:  # not kept without the ledger: what it has may say something else
            self._refuse(request, error, is_kept=error.code != UNAVAILABLE)
            return
        errand = Errand(request, self._desk, is_repeat=earlier is not None and _is_same(request, earlier))
        errand.accept()
        if request.verb == STOP:
            self._stop(errand, starter)
        else:
            self._begin(Conduct(errand, starter, preparation))

    def reject(self, request: Refusable, code: str, text: str) -> None:
        """Reject a command that is not fit to be submitted; a repetition gets the first one's result."""
        known = CommandRequest(
            starter=request.starter,
            client=request.client,
            verb=request.verb,
            id=request.id,
            args=request.args,
            operator=request.operator,
            correlation=request.correlation,
        )
        earlier = self._ledger.find(known.client, known.id)
        if earlier is not None and _is_same(known, earlier):
            self._repeat(known, earlier)
        else:
            self._refuse(known, CommandError(code, text), is_kept=False)

    def recall(self, commands: Iterable[Remembered]) -> None:
        """Take over the commands of earlier runs, the oldest first; say once what was cut short."""
        for remembered in commands:
            result = remembered.result
            if self._ledger.find(result.client, result.id) is not None:
                continue  # a stop that came before the ledger could be read
            if not result.phase.is_final:
                starter = self._starters.get(result.starter)
                aftermath = Aftermath(remembered, starter, self._desk)
                result = aftermath.result()
                self._spawn(aftermath.tell())
            age_s = self._desk.clock.utc_s() - remembered.since_s
            self._ledger.store(result, now_s=self._desk.clock.now_s() - age_s)

    async def close(self) -> None:
        """Write nothing more: end every command, rejected or unconfirmed, and take no new one."""
        self._is_closing = True
        for conduct in self._conducts.values():
            conduct.halt("shutting_down")
        for stopping in self._stops.values():
            stopping.halt("shutting_down")
        if self._tasks:
            await asyncio.wait(self._tasks)

    def _check_sender(self, request: CommandRequest) -> None:
        """Raise CommandError unless the starter and the verb exist and this client has the right to it."""
        starter = self._starters.get(request.starter)
        if starter is None:
            raise CommandError("unknown_starter", "this gateway has no such starter")
        if request.verb not in verbs(starter.profile):
            raise CommandError("unknown_verb", f"{starter.profile.title} has no verb {request.verb[:40]!r}")
        if not self._rights.is_allowed(request.client, verb=request.verb, starter=request.starter):
            text = f"{request.client} has no right to {request.verb} {request.starter}"
            raise CommandError("not_allowed", text)
        if not request.id and request.verb != STOP:
            raise CommandError("no_id", "every command but stop needs an id")

    def _check(self, request: CommandRequest, starter: StarterControlView) -> Preparation:
        """Return what to read before the command; CommandError when it cannot even begin."""
        if self._is_closing:
            raise CommandError("shutting_down", HALTED["shutting_down"])
        if request.verb == STOP:
            return prepare(starter.profile, starter.variant, STOP, {})
        if self._journal.trouble:
            raise CommandError(UNAVAILABLE, f"commands are not taken without the ledger: {self._journal.trouble}")
        preparation = prepare(starter.profile, starter.variant, request.verb, request.args)
        if not starter.is_answering:
            raise CommandError("offline", "the starter does not answer")
        if starter.identity_standing is not Standing.MATCHING:
            raise CommandError(f"identity_{starter.identity_standing.value}", starter.identity_reason)
        if request.starter in self._conducts or request.starter in self._stops:
            raise CommandError("busy", "another command for this starter is under way")
        return preparation

    def _is_done_again(self, request: CommandRequest, earlier: ResultRecord) -> bool:
        """Return whether a command is carried out although its id is known: a stop that is not under way."""
        is_under_way = _is_same(request, earlier) and not earlier.phase.is_final
        return request.verb == STOP and not is_under_way

    def _repeat(self, request: CommandRequest, earlier: ResultRecord) -> None:
        """Send the stored result of a command again; an id that stood for another command is refused."""
        if not _is_same(request, earlier):
            text = f"this id was used for {earlier.verb} of {earlier.starter}"
            self._refuse(request, CommandError("id_reused", text), is_kept=False)
            return
        correlation, response_topic = request.correlation, request.response_topic
        self._desk.sink.put(
            replace(earlier, is_duplicate=True, correlation=correlation, response_topic=response_topic)
        )
        audit(request, self._desk, decision="duplicate", code=earlier.code)

    def _refuse(self, request: CommandRequest, error: CommandError, *, is_kept: bool) -> None:
        Errand(request, self._desk).finish(End(Phase.REJECTED, error.code, error.text), is_kept=is_kept)

    def _begin(self, conduct: Conduct) -> None:
        name = conduct.errand.request.starter
        self._conducts[name] = conduct
        self._spawn(self._until_done(name, conduct))

    def _stop(self, errand: Errand, starter: StarterControlView) -> None:
        """Cut what this starter is doing, then stop it; a stop that is under way is joined."""
        name = errand.request.starter
        conduct = self._conducts.get(name)
        if conduct is not None:
            conduct.halt("stopped_first")
        stopping = self._stops.get(name)
        if stopping is None:
            stopping = self._stops[name] = Stopping(starter)
            self._spawn(self._until_stopped(name, stopping))
        stopping.join(errand)

    async def _until_done(self, name: str, conduct: Conduct) -> None:
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


def _is_same(request: CommandRequest, earlier: ResultRecord) -> bool:
    return (request.starter, request.verb) == (earlier.starter, earlier.verb)
