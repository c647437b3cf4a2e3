"""Carries out one command other than a stop: read, judge twice, write once, read back."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import replace
from math import inf
from typing import Any, assert_never

from gateway.errors import CommandError
from gateway.families.command import build
from gateway.families.decode import decode_row
from gateway.families.interlock import check
from gateway.families.parameters import find
from gateway.families.procedure import Expect, Preparation, Procedure, WriteStep
from gateway.line.job import Lane
from gateway.line.outcome import TOO_LATE, Answered, Garbled, Outcome, Refused, Silent
from gateway.modbus.codes import ExceptionCode
from gateway.starters.control import StarterControlView
from gateway.starters.errand import End, Errand
from gateway.starters.guard import Guard
from gateway.starters.known_watchdogs import KnownWatchdogs
from gateway.starters.records import Phase
from gateway.starters.wire import HaltedError, RefusedError, Rows, Wire

logger = logging.getLogger(__name__)

MOST_READINGS = 4  # until two in a row agree
RECENT_PERIODS = 2  # a poll of this age still counts as one of the two readings,
SLOW_DISK_S = 0.25  # what was read before a disk took this long is read again
RECENT_AT_MOST_S = 10.0  # however rarely the starter is polled
MAY_BE_TURNING = "the motor may be turning"
CAN_WAIT = frozenset({"read", "set", "configure", "output"})  # verbs that move no motor

HALTED = {
    "stopped_first": "a stop came first",
    "locked": "a maintenance lock came first",
    "shutting_down": "the gateway is shutting down",
}


class Conduct:
    """One accepted command under way; `run` always ends with the command's final result."""

    def __init__(
        self,
        errand: Errand,
        starter: StarterControlView,
        preparation: Preparation,
        guard: Guard | None = None,
        watchdogs: KnownWatchdogs | None = None,
    ) -> None:
        self.errand = errand
        self._starter = starter
        self._preparation = preparation
        self._guard = guard  # what the gateway itself demands
        self._watchdogs = watchdogs or KnownWatchdogs()  # of the starters that share its line
        self.can_wait = errand.request.verb in CAN_WAIT
        self._lane = Lane.PARAMETERS if self.can_wait else Lane.COMMAND
        self._wire = Wire(starter, read_back_lane=Lane.PARAMETERS if self.can_wait else Lane.READ_BACK)
        self._procedure: Procedure | None = None  # once it is being written

    @property
    def line(self) -> str:
        """The name of its starter's line."""
        return self._starter.setup.line

    def halt(self, code: str) -> None:
        """Let nothing more of this command go out."""
        self._wire.halt(code)

    async def run(self) -> None:
        """Carry the command out; never raises."""
        try:
            end = await self._ended()
        except Exception:  # the guard at the task's top
            logger.exception("starter=%s command ended by a bug", self.errand.request.starter)
            end = self._cut("internal", "an error inside the gateway; see its log")
        self._watchdogs.end(self.errand.request.starter)
        self.errand.finish(end)

    async def _ended(self) -> End:
        try:
            rows, procedure = await self._decide()
            if procedure.steps and await self._intend(procedure) > SLOW_DISK_S:
                rows, procedure = await self._decide()  # what was read has grown old meanwhile
            if not procedure.steps:
                return self._unwritten(procedure, rows)
            self.errand.wear_out(procedure.wears)
            return await self._carry_out(procedure)
        except CommandError as error:
            return self._cut(error.code, error.text)
        except RefusedError as error:
            return End(Phase.FAILED, error.code, str(error))
        except HaltedError as error:
            if error.code != "shutting_down":  # nothing is written at shut-down
                await self._leave_safe()
            return self._cut(error.code, HALTED.get(error.code, error.code))

    async def _intend(self, procedure: Procedure) -> float:
        """Have it kept, and admitted, that something is about to be written; return how long that took."""
        began_s = self.errand.now_s()
        await self._wire.wait_for(self._watchdogs.admit(self.errand.request.starter, procedure))
        await self._wire.wait_for(self.errand.intend())
        if self._guard is not None:
            await self._wire.wait_for(self._guard.admit())
        return self.errand.now_s() - began_s

    def _cut(self, code: str, text: str) -> End:
        """Return the end of a command that something came in the way of."""
        if self.errand.life.is_written:
            return End(Phase.UNCONFIRMED, code, f"{text}; it was written before: {MAY_BE_TURNING}")
        if code == "internal":
            return End(Phase.FAILED, code, text)
        return End(Phase.REJECTED, code, f"{text}; nothing was written")

    async def _decide(self) -> tuple[Rows, Procedure]:
        """Return what to do, once two readings in a row allow it and lead to the same steps."""
        earlier = self._judge_recent()
        for _ in range(MOST_READINGS):
            rows = await self._wire.read(self._preparation.reads, lane=self._lane)
            self.errand.before = self._points(rows)
            procedure = self._judge(rows)
            is_enough = not self._preparation.reads or _only_reads(procedure)
            if is_enough or procedure == earlier:
                return rows, procedure
            earlier = procedure
        raise CommandError("readings_disagree", "no two readings in a row of the starter agree")

    def _judge_recent(self) -> Procedure | None:
        """Return what the last polls would lead to; None when they are too old, lack a row or forbid it."""
        longest_s = min(RECENT_PERIODS * self._starter.status_period_s, RECENT_AT_MOST_S)
        since_s = self.errand.now_s() - longest_s
        recent = self._starter.snapshot.rows_since(since_s)
        codes = {code for read in self._preparation.reads for code in read.codes}
        if not codes <= recent.keys():
            return None
        try:
            return self._judge({code: recent[code] for code in codes})
        except CommandError:
            return None

    def _judge(self, rows: Rows) -> Procedure:
        """Return the steps that follow from these rows; CommandError when a rule forbids them."""
        profile, request = self._starter.profile, self.errand.request
        violations = check(profile, self._preparation.requires, self._points(rows))
        if violations:
            text = "; ".join(violation.text for violation in violations)
            raise CommandError(violations[0].rule, text)
        if self._guard is not None:
            self._guard.check(self._points(rows))
        return build(profile, self._starter.variant, request.verb, request.args, seen=rows)

    async def _carry_out(self, procedure: Procedure) -> End:
        """Write each step once, each only after what the one before has to bring about."""
        self._procedure = procedure
        for step in procedure.steps:
            end = await self._take_step(step, is_last=step is procedure.steps[-1])
            if end is not None:
                return await self._abandoned(end)
        if procedure.verify is None:
            text = f"written, but it cannot be read back: {MAY_BE_TURNING}"
            return End(Phase.UNCONFIRMED, "not_readable", text)
        values = await self._wire.see(procedure.verify)
        if values is None:
            end = _not_seen(procedure.verify)
            return await self._abandoned(replace(end, text=_noted(end.text, procedure)))
        return self._confirmed(procedure, values)

    async def _take_step(self, step: WriteStep, *, is_last: bool) -> End | None:
        """Write one step and see what it must bring about; return the end when the next must not follow."""
        outcome = await self._write(step)
        end = self._taken(outcome)
        if end is not None:
            return end
        if step.then is not None:
            return None if await self._wire.see(step.then) is not None else _not_seen(step.then)
        if is_last or step.is_silence_expected or isinstance(outcome, (Answered, Refused)):
            return None
        return self._cut("no_answer", f"a write before the last was not answered ({outcome.reason})")

    async def _write(self, step: WriteStep) -> Outcome:
        """Send one write, once."""
        if step.is_silence_expected:
            setup = self._starter.setup
            self._starter.line.expect_silence(setup.address, setup.profile.timing.restart_s)
        try:
            return await self._wire.write(step.request, lane=self._lane, until_s=self._until_s())
        except HaltedError:
            self.errand.write()  # it may have been on its way already
            raise

    def _until_s(self) -> float:
        """Return how late the first write may be sent: what has begun is not left half done."""
        expires_s = self.errand.request.expires_s
        return inf if expires_s is None or self.errand.life.is_written else expires_s

    def _taken(self, outcome: Outcome) -> End | None:
        """Take over what became of a write; return the end when it did not go out or was refused."""
        match outcome:
            case Answered() | Refused(code=ExceptionCode.ACKNOWLEDGE):
                self.errand.write()
                return None
            case Refused():
                refusal = RefusedError(outcome.code)
                return End(Phase.FAILED, refusal.code, str(refusal))
            case Silent(reason=reason, is_sent=False) if reason == TOO_LATE:
                return self._cut("expired", "the line was not free while the command was valid")
            case Silent(is_sent=False) | Garbled(is_sent=False):
                return self._cut("line_down", f"the write could not be sent: {outcome.reason}")
            case Silent() | Garbled():
                self.errand.write()
                return None  # whether it acted is for the read-back to say
            case _:
                assert_never(outcome)

    def _unwritten(self, procedure: Procedure, rows: Rows) -> End:
        """Return the end of a command that has nothing to write."""
        values = self._subject(procedure, rows)
        if procedure.is_unchanged:
            text = _noted("the starter holds this value already", procedure)
            return End(Phase.CONFIRMED, "unchanged", text, values)
        return End(Phase.CONFIRMED, "ok", "read", values)

    def _confirmed(self, procedure: Procedure, values: dict[str, Any]) -> End:
        subject = self._subject(procedure, values)
        points = {name: value for name, value in values.items() if not isinstance(value, tuple)}
        return End(Phase.CONFIRMED, "ok", _noted("read back from the starter", procedure), subject, points)

    def _subject(self, procedure: Procedure, rows: Mapping[str, Any]) -> dict[str, Any]:
        """Return the rows that were read or set, as a result tells them; nothing for other commands."""
        if procedure.subjects:
            return {"values": {code: self._told(code, rows[code]) for code in procedure.subjects}}
        if procedure.subject not in rows:
            return {}
        return {"parameter": procedure.subject, **self._told(procedure.subject, rows[procedure.subject])}

    def _told(self, code: str, words: tuple[int, ...]) -> dict[str, Any]:
        row = find(self._starter.profile, code)
        decoded = decode_row(self._starter.profile, self._starter.variant, row, words)
        return {
            "value": decoded.value,
            "unit": decoded.unit,
            "label": decoded.label,
            "raw": list(decoded.raw),
        }

    def _points(self, rows: Rows) -> dict[str, Any]:
        return {name: value for name, value in self._wire.values(rows).items() if name not in rows}

    async def _abandoned(self, end: End) -> End:
        """Return the end of a command that failed after its first write, once the starter is left safe."""
        if await self._leave_safe() or end.phase is not Phase.FAILED:
            return end
        return End(Phase.UNCONFIRMED, end.code, f"{end.text}; and it could not be left as it was")

    async def _leave_safe(self) -> bool:
        """Write what the procedure names for this case, if it was begun; return whether that was taken."""
        if self._procedure is None or not self.errand.life.is_written:
            return True
        wire = Wire(self._starter)  # what halts the command does not halt this
        outcomes = [await wire.write(request, lane=Lane.COMMAND) for request in self._procedure.abandon]
        return all(isinstance(outcome, Answered) for outcome in outcomes)


def _only_reads(procedure: Procedure) -> bool:
    return not procedure.steps and not procedure.is_unchanged


def _noted(text: str, procedure: Procedure) -> str:
    """Return a result's text with what the operator must know besides."""
    return f"{text}; {procedure.note}" if procedure.note else text


def _not_seen(expect: Expect) -> End:
    text = f"{expect.name} did not become what was commanded within {expect.within_s:g} s: {MAY_BE_TURNING}"
    return End(Phase.UNCONFIRMED, "not_seen", text)
