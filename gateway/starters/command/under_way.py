"""What is under way: of each starter one command, and its stop, which goes before everything.

A stop cuts the command of its starter. A start or jog that did not act is taken back by a stop that the
gateway asks for: it makes no new token and cancels nothing, and it gives way to the next command.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Collection, Coroutine, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from gateway.contract import LOCK, READ, STOP, CommandError, Reason, ResultCode
from gateway.families import Expect, Preparation
from gateway.starters.command.own_verbs import Deed
from gateway.starters.command.report import CommandReport, Retention
from gateway.starters.command.run.decision import CAN_WAIT, Judge
from gateway.starters.command.run.pipeline import CommandRun
from gateway.starters.command.stop.machine import StopOrder, Stopping
from gateway.starters.command.wire import HaltedError
from gateway.starters.policy.policy import GATEWAY, Guard
from gateway.starters.policy.preconditions import is_forbidden
from gateway.starters.starter import StarterTelemetry

logger = logging.getLogger(__name__)

_Work = TypeVar("_Work", CommandRun, Stopping)

AT_ONCE = 4  # commands of a line that have not yet done their first write: all at once would all expire


@dataclass(eq=False)
class UnderWay:
    """The commands and stops of all starters that are being carried out; all calls on the app's loop."""

    starters: Mapping[str, StarterTelemetry]

    def __post_init__(self) -> None:
        self._runs: dict[str, CommandRun] = {}
        self._stops: dict[str, Stopping] = {}
        self._slots: dict[tuple[str, bool], asyncio.Semaphore] = {}  # by line, and whether they can wait
        self._tasks: set[asyncio.Task[None]] = set()
        self.is_closing = False
        self._leaving: Collection[str] = ()  # starters whose configuration is about to change

    def demand_free(self, name: str) -> None:
        """Raise CommandError for a starter under a command, a client's stop or a reload."""
        if name in self._runs or (name in self._stops and not self._stops[name].is_own):
            raise CommandError(ResultCode.BUSY, "command")
        if name in self._leaving:
            raise CommandError(ResultCode.BUSY, "reload")

    def begin(self, preparation: Preparation, guard: Guard, report: CommandReport) -> None:
        """Carry out an accepted command other than a stop."""
        name, verb = report.request.starter, report.request.verb
        starter, slot = self.starters[name], None
        if verb != READ:  # which changes nothing at the starter, and needs no slot
            if name in self._stops:
                self._stops.pop(name).give_way()
            line = starter.setup.line, verb in CAN_WAIT  # the two do not wait for each other
            slot = self._slots.setdefault(line, asyncio.Semaphore(AT_ONCE))
        run = CommandRun(Judge(report, starter, preparation, guard), slot, self._run_off)
        self._carry_out(self._runs, name, run)

    def do(self, deed: Deed, report: CommandReport) -> None:
        """Carry out one of the gateway's own verbs, at once but for what waits for the disk."""
        try:
            stored = deed.send(report)
        except StopIteration as over:
            report.finish(over.value)
        else:
            self._spawn(_finish(report, deed, stored))
        if report.request.verb == LOCK:
            self._cut_for_lock(report.request.starter)

    def stop(self, name: str) -> bool:
        """Cut what this starter is doing, and have a frame sent for one more stop message.

        Return whether it shares its frame with others, since too many came at once.
        """
        run = self._runs.get(name)
        if run is not None:
            run.wire.halt(Reason(ResultCode.STOPPED_FIRST, "cut"))
        is_jog = run is not None and run.report.request.verb == "jog"
        return self._stopping(name).ask(with_jog=is_jog).is_shared

    def join(self, report: CommandReport) -> None:
        """Have an accepted stop answered, for which a frame was asked."""
        self._stops[report.request.starter].join(report)

    async def settle(self, starters: Collection[str], *, within_s: float) -> None:
        """Wait until these starters are under no command; they take none but stop until `reopen`."""
        self._leaving = starters
        with suppress(TimeoutError):
            async with asyncio.timeout(within_s):
                while any(name in self._runs or name in self._stops for name in starters):
                    await asyncio.wait(self._tasks, return_when=asyncio.FIRST_COMPLETED)

    def reopen(self) -> None:
        """Take commands for every starter again, and cut what is still under way for those that have left.

        A name may stand for another device now: a stop that joined the old one's would go to that.
        """
        for name in self._leaving:
            for work in (self._runs.pop(name, None), self._stops.pop(name, None)):
                if work is not None:
                    work.wire.halt(Reason(ResultCode.BUSY, "reloaded"))
        self._leaving = ()

    async def close(self) -> None:
        """Write nothing more, and wait for everything to end."""
        self.is_closing = True
        under_way: list[CommandRun | Stopping] = [*self._runs.values(), *self._stops.values()]
        for work in under_way:
            work.wire.halt(Reason(ResultCode.SHUTTING_DOWN))
        if self._tasks:
            await asyncio.wait(self._tasks)

    def _stopping(self, name: str) -> Stopping:
        """Return the stop of a starter, which begins now unless it is under way."""
        if name not in self._stops:
            self._carry_out(self._stops, name, Stopping(self.starters[name]))
        return self._stops[name]

    def _cut_for_lock(self, name: str) -> None:
        """Let a command that the lock forbids not be written any more; what is written is still read back."""
        run = self._runs.get(name)
        if run is None or run.report.is_written:
            return
        if is_forbidden(run.report.request.verb, run.report.request.args):
            run.wire.halt(Reason(ResultCode.LOCKED, "cut"))

    def _run_off(self, report: CommandReport, released: Expect) -> StopOrder:
        """Have the starter stopped until what a failed command left is seen to be gone; the audit has it."""
        request = replace(report.request, verb=STOP, args={}, source=GATEWAY)
        own = CommandReport(request, report.reporting, retention=Retention.AUDIT)
        order = self._stopping(request.starter).ask(released)
        order.report = own
        own.accept()
        return order

    def _carry_out(self, under_way: dict[str, _Work], name: str, work: _Work) -> None:
        under_way[name] = work
        self._spawn(_run_out(under_way, name, work))

    def _spawn(self, work: Coroutine[Any, Any, None]) -> None:
        """Carry something out in a task of its own, for whose end `close` waits."""
        task = asyncio.get_running_loop().create_task(work)
        self._tasks.add(task)  # the loop itself keeps only a weak reference
        task.add_done_callback(self._tasks.discard)


async def _run_out(under_way: dict[str, _Work], name: str, work: _Work) -> None:
    """Run what is under way for a starter to its end, and let nothing more of it go out then."""
    try:
        await work.run()
    except HaltedError as error:
        work.cut(error.reason)
    except Exception:  # the guard at the task's top
        logger.exception("starter=%s command ended by a bug", name)
        work.cut(Reason(ResultCode.INTERNAL))
    finally:
        work.wire.halt(Reason(ResultCode.SHUTTING_DOWN))
        if under_way.get(name) is work:  # else it gave way
            del under_way[name]


async def _finish(report: CommandReport, deed: Deed, stored: Awaitable[bool] | None) -> None:
    try:
        deed.send(stored and await stored)
    except StopIteration as over:
        report.finish(over.value)
