"""Carries out one command other than a stop: read, judge twice, write once, read back."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Coroutine, Mapping, Sequence
from dataclasses import replace
from math import inf
from typing import Any, TypeVar, assert_never

from gateway.contract import CommandError, Note, Phase, Reason, ResultCode
from gateway.families import Expect, Preparation, Procedure, TakeBack, WriteStep, command, decode, parameters
from gateway.line import TOO_LATE, Answered, Garbled, Outcome, Priority, Refused, Silent
from gateway.modbus.codes import ExceptionCode, exception_name
from gateway.modbus.pdu import Request
from gateway.starters.commands.admission import CAN_WAIT
from gateway.starters.commands.lifecycle import CommandReport, Final
from gateway.starters.commands.starter_io import (
    LAST_READING_S,
    HaltedError,
    OverdueError,
    RefusedError,
    Rows,
    StarterIo,
)
from gateway.starters.known_watchdogs import KnownWatchdogs
from gateway.starters.policy.preconditions import Guard
from gateway.starters.view import StarterControlView

logger = logging.getLogger(__name__)

T = TypeVar("T")

MOST_READINGS = 4  # until two in a row agree
RECENT_PERIODS = 2  # a poll of this age still counts as one of the two readings,
SLOW_DISK_S = 0.25  # what was read before a disk took this long is read again
RECENT_AT_MOST_S = 10.0  # however rarely the starter is polled
DECIDES_FOR_S = 2.0  # after that a reading decides about no motor any more: much can have happened since
CLEARS_FOR_S = 5.0  # after run = 0: then who commands the motor is changed no more by the same procedure
WAITS_FOR_S = 10.0  # the same of what moves no motor, and may wait for the line
ASKED_AGAIN_S = 0.5  # after this a starter that did not answer is asked again, while the command has time
LATER_STEP_S = 2.0  # the line may take so long for each write after the first
LEFT_SAFE_WITHIN_S = 3.0  # after its deadline a start is taken back, or the starter left safe
MOST_TAKE_BACKS = 3  # each after new readings of a motor that stands
MAY_BE_TURNING = Note("may_be_turning")
MAY_ACT_LATER = Note("may_act_later")
LOOK = Note("look")
_NOT_SET_UP = (  # what a write is refused with that the starter is not set up for, or does not have
    ExceptionCode.ILLEGAL_FUNCTION,
    ExceptionCode.ILLEGAL_DATA_ADDRESS,
    ExceptionCode.ILLEGAL_DATA_VALUE,
)
_MAY_ACT = (  # a motion that is refused so may begin all the same
    ExceptionCode.SERVER_DEVICE_BUSY,
    ExceptionCode.GATEWAY_PATH_UNAVAILABLE,
    ExceptionCode.GATEWAY_TARGET_DEVICE_FAILED_TO_RESPOND,
)


class _OutdatedError(Exception):
    """What was decided has not been written, and is to be decided again."""


class CommandExecution:
    """One accepted command under way; `run` always ends with the command's final result."""

    def __init__(
        self,
        report: CommandReport,
        starter: StarterControlView,
        preparation: Preparation,
        guard: Guard | None = None,
        gate: asyncio.Semaphore | None = None,
        watchdogs: KnownWatchdogs | None = None,
    ) -> None:
        self.report = report
        self._starter = starter
        self._preparation = preparation
        self._guard = guard  # what the gateway itself demands
        self._gate = gate  # among the commands of its line, until its first write; None: it does not wait
        self._is_in_gate = False
        self._watchdogs = watchdogs or KnownWatchdogs()  # of the starters that share its line
        self.can_wait = report.request.verb in CAN_WAIT
        self._lane = Priority.PARAMETERS if self.can_wait else Priority.COMMAND
        self._starter_io = StarterIo(
            starter, read_back_lane=Priority.PARAMETERS if self.can_wait else Priority.READ_BACK
        )
        self._starter_io.until_s = report.request.until_s
        self._procedure: Procedure | None = None  # once it is being written
        self._cleared_s = inf  # when run = 0 was taken, as its request was asked
        self._refusal: RefusedError | None = None  # of a motion that may have begun all the same

    @property
    def line(self) -> str:
        """The name of its starter's line."""
        return self._starter.setup.line

    def halt(self, reason: Reason) -> None:
        """Let nothing more of this command go out."""
        self._starter_io.halt(reason)

    async def run(self) -> None:
        """Carry the command out; never raises."""
        try:
            end = await self._ended()
        except Exception:  # the guard at the task's top
            logger.exception("starter=%s command ended by a bug", self.report.request.starter)
            end = self._cut(Reason(ResultCode.INTERNAL))
        self._leave_gate()
        self._watchdogs.end(self.report.request.starter)
        self.report.finish(end)

    async def _ended(self) -> Final:
        try:
            if self._gate is not None:
                await self._starter_io.wait_for(self._gate.acquire())
                self._is_in_gate = True
            rows, procedure = await self._decide()
            if procedure.steps and await self._intend(procedure) > SLOW_DISK_S:
                rows, procedure = await self._decide()  # what was read has grown old meanwhile
            if not procedure.steps:
                return self._unwritten(procedure, rows)
            self.report.count_memory_writes(procedure.wears)
            while True:
                try:
                    return await self._carry_out(procedure)
                except _OutdatedError:
                    rows, procedure = await self._decide()
                    if not procedure.steps:
                        return self._unwritten(procedure, rows)
        except CommandError as error:
            return self._cut(error.reason)
        except RefusedError as error:
            return Final(Phase.FAILED, error.reason)
        except OverdueError:
            if self._procedure is None or self._procedure.take_back is None:  # a start is taken back only
                await self._leave_safe()  # once the motor is seen to stand
            return self._expired()
        except HaltedError as error:
            if error.reason.code != ResultCode.SHUTTING_DOWN:  # nothing is written at shut-down
                await self._leave_safe()
            return self._cut(error.reason)

    async def _intend(self, procedure: Procedure) -> float:
        """Have it admitted and stored that something is about to be written; return how long that took."""
        began_s = self.report.now_s()
        await self._starter_io.wait_for(self._watchdogs.admit(self.report.request.starter, procedure))
        await self._starter_io.wait_for(self.report.intend())
        if self._guard is not None:
            await self._starter_io.wait_for(self._guard.admit())
        return self.report.now_s() - began_s

    def _cut(self, reason: Reason) -> Final:
        """Return the end of a command that something came in the way of."""
        if self.report.life.is_written:
            is_pending = reason.code in (ResultCode.SHUTTING_DOWN, ResultCode.NOT_SEEN)
            later = MAY_ACT_LATER if is_pending and self.report.request.verb in command.TAKEN_BACK else None
            return Final(Phase.UNCONFIRMED, reason.noted(Note("written_before"), self._outlook, later))
        if reason.code == ResultCode.INTERNAL:
            return Final(Phase.FAILED, reason)
        return Final(Phase.REJECTED, reason.noted(Note("nothing_written")))

    async def _decide(self) -> tuple[Rows, Procedure]:
        """Return what to do, once two readings in a row allow it and lead to the same steps."""
        earlier = self._judge_recent()
        for _ in range(MOST_READINGS):
            rows = await self._insist(lambda: self._starter_io.read(self._preparation.reads, lane=self._lane))
            self.report.before = self._points(rows)
            procedure = self._judge(rows)
            is_enough = not self._preparation.reads or _only_reads(procedure)
            if is_enough or procedure == earlier:
                return rows, procedure
            earlier = procedure
        raise CommandError(ResultCode.READINGS_DISAGREE)

    async def _insist(self, ask: Callable[[], Coroutine[Any, Any, T]]) -> T:
        """Ask until that is answered, as long as the starter is online."""
        while True:
            try:
                return await ask()
            except CommandError as error:
                if error.code != ResultCode.NO_ANSWER or not self._starter.is_answering:
                    raise
            await self._starter_io.pause(ASKED_AGAIN_S)

    def _judge_recent(self) -> Procedure | None:
        """Return what the last polls would lead to; None when they are too old, lack a row or forbid it."""
        longest_s = min(RECENT_PERIODS * self._starter.status_period_s, RECENT_AT_MOST_S)
        since_s = self.report.now_s() - longest_s
        if self.report.is_outdated(since_s):
            return None  # some of it may have been read before the gateway stood still
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
        profile, request = self._starter.profile, self.report.request
        command.demand(profile, self._preparation.requires, self._points(rows))
        if self._guard is not None:
            self._guard.check(self._points(rows))
        return command.build(profile, self._starter.variant, request.verb, request.args, seen=rows)

    async def _carry_out(self, procedure: Procedure) -> Final:
        """Write each step once, each only after what the one before has to bring about.

        Who answers is asked before the first, and after each reading between them, which takes its time.
        """
        await self._prove()
        self._procedure = procedure
        for place, step in enumerate(procedure.steps, 1):
            if place > 1 and procedure.steps[place - 2].then is not None:
                await self._prove()
            is_last = all(later.may_be_refused for later in procedure.steps[place:])
            end = await self._take_step(step, is_last=is_last)
            if end is not None:
                is_left = step.is_run_off or procedure.take_back is not None
                return end if is_left else await self._abandoned(end)
        if procedure.verify is None:
            return Final(Phase.UNCONFIRMED, Reason(ResultCode.NOT_READABLE, "command").noted(self._outlook))
        values = await self._starter_io.see(procedure.verify)
        if values is None:
            end = self._not_seen(procedure.verify)
            if procedure.take_back is not None:
                return await self._taken_back(end, self.report.request.verb, procedure.take_back)
            return await self._abandoned(end.noted(*procedure.notes))
        await self._prove_again()
        return self._confirmed(procedure, values)

    async def _prove(self) -> None:
        """Raise CommandError unless the device that was identified answers now."""
        await self._insist(lambda: self._starter_io.wait_for(self._starter.prove(lane=self._lane)))

    async def _prove_again(self) -> None:
        """Raise CommandError when another device answers now: what was read back may be its own."""
        try:
            await self._starter_io.wait_for(self._starter.prove(lane=self._lane))
        except OverdueError:
            pass
        except CommandError as error:
            if error.code != ResultCode.NO_ANSWER:
                raise

    async def _take_step(self, step: WriteStep, *, is_last: bool) -> Final | None:
        """Write one step and see what it must bring about; return the end when the next must not follow."""
        outcome = await self._write(step)
        is_excused = step.may_be_refused and isinstance(outcome, Refused) and outcome.code in _NOT_SET_UP
        end = None if is_excused else self._taken(outcome)
        if step.is_run_off:
            return await self._run_off(step, outcome, end, is_excused=is_excused)
        if end is not None:
            return end
        if step.then is not None:
            return None if await self._starter_io.see(step.then) is not None else self._not_seen(step.then)
        if is_last or step.is_silence_expected or isinstance(outcome, (Answered, Refused)):
            return None
        return self._cut(Reason(ResultCode.NO_ANSWER, "write", reason=outcome.reason))

    async def _run_off(
        self, step: WriteStep, outcome: Outcome, end: Final | None, *, is_excused: bool
    ) -> Final | None:
        """Return the end when run = 0 was not taken: nothing that lets a run command act may follow."""
        if isinstance(outcome, Refused) and end is not None:
            exception = exception_name(outcome.code)
            reason = Reason(ResultCode.RUN_NOT_CLEARED, "refused", exception=exception)
            return Final(Phase.FAILED, reason.noted(Note("nothing_else")))
        if end is not None:
            return end
        self._cleared_s = min(self._cleared_s, self._starter_io.seen_s)
        if not is_excused and not isinstance(outcome, (Answered, Refused)):
            reason = Reason(ResultCode.NO_ANSWER, "run_off", reason=outcome.reason)
            return Final(Phase.UNCONFIRMED, reason.noted(Note("nothing_else")))
        if step.then is None or await self._starter_io.see(step.then) is not None:
            return None
        if isinstance(outcome, Answered) and await self._starter_io.is_refused(step.then.reads, _NOT_SET_UP):
            rows = await self._starter_io.read(self._preparation.reads, lane=self._lane)
            command.demand(self._starter.profile, self._preparation.requires, self._points(rows))
            return None
        point, within_s = step.then.name, step.then.within_s
        reason = Reason(ResultCode.RUN_NOT_CLEARED, "unseen", point=point, within_s=within_s)
        return Final(Phase.FAILED, reason.noted(Note("nothing_else")))

    @property
    def _outlook(self) -> Note:
        """What may be the case once something was written and not seen to act."""
        wakes = self._procedure is not None and self._procedure.is_run_cleared
        return MAY_BE_TURNING if wakes or not self.can_wait else LOOK

    def _not_seen(self, expect: Expect) -> Final:
        point, within_s = expect.name, expect.within_s
        if self._outlook is LOOK:
            reason = Reason(ResultCode.NOT_FOLLOWED, "reading", point=point, within_s=within_s)
            return Final(Phase.UNCONFIRMED, reason.noted(LOOK))
        if self._procedure is not None and self._procedure.is_run_cleared:
            reason = Reason(ResultCode.NOT_SEEN, "standstill", point=point, within_s=within_s)
            return Final(Phase.UNCONFIRMED, reason.noted(Note("run_off_again"), MAY_BE_TURNING))
        reason = Reason(ResultCode.NOT_SEEN, "motion", point=point, within_s=within_s)
        if self._refusal is not None:
            return Final(Phase.UNCONFIRMED, self._refusal.reason.noted(reason, MAY_BE_TURNING))
        return Final(Phase.UNCONFIRMED, reason.noted(MAY_BE_TURNING))

    async def _write(self, step: WriteStep) -> Outcome:
        """Send one write, once."""
        if step.is_silence_expected:
            setup = self._starter.setup
            self._starter.line.expect_silence(setup.address, setup.profile.timing.restart_s)
        try:
            outcome = await self._hand_over(step)
        except (HaltedError, OverdueError):
            self.report.write()  # it may have been on its way already
            raise
        self._leave_gate()
        return outcome

    def _leave_gate(self) -> None:
        if self._gate is not None and self._is_in_gate:
            self._is_in_gate = False
            self._gate.release()

    async def _hand_over(self, step: WriteStep) -> Outcome:
        """Give a write to the line, which sends it only while what was read last still decides.

        _OutdatedError when it does not any more and nothing has been written yet. What moves no motor is not
        left half done: its later writes go out whenever the line is free, unless they choose who commands the
        motor: a run command may have been given since run = 0 was written.
        """
        is_begun = self.report.life.is_written
        may_wait = self.can_wait and not (self._procedure is not None and self._procedure.is_source)
        if is_begun and may_wait:
            return await self._starter_io.write(step.request, lane=self._lane)
        deadline_s = self._starter_io.until_s
        until_s = self._starter_io.seen_s + (WAITS_FOR_S if may_wait else DECIDES_FOR_S)
        until_s = min(until_s, self._cleared_s + CLEARS_FOR_S, deadline_s)
        if not is_begun:
            self._starter_io.until_s = until_s + self._seen_within_s
        outcome: Outcome = Silent(TOO_LATE, is_sent=False)
        if not self.report.is_outdated(min(self._starter_io.seen_s, self._cleared_s)):
            outcome = await self._starter_io.write(step.request, lane=self._lane, until_s=until_s)
        is_unsent = isinstance(outcome, Silent) and outcome.reason == TOO_LATE and not outcome.is_sent
        if not is_begun:
            self._starter_io.until_s = deadline_s if is_unsent else self.report.now_s() + self._seen_within_s
        if is_unsent and not is_begun and self.report.now_s() < deadline_s:
            raise _OutdatedError
        return outcome

    @property
    def _seen_within_s(self) -> float:
        """How long after its first write the whole command is to be seen: the family's times."""
        steps, verify = (self._procedure.steps, self._procedure.verify) if self._procedure else ((), None)
        seen_s = sum(each.within_s for each in (*(step.then for step in steps), verify) if each is not None)
        return seen_s + LATER_STEP_S * (len(steps) - 1) + LAST_READING_S

    def _taken(self, outcome: Outcome) -> Final | None:
        """Record the outcome of a write; return the end when it did not go out or was refused."""
        match outcome:
            case Answered() | Refused(code=ExceptionCode.ACKNOWLEDGE):
                self.report.write()
                return None
            case Refused():
                refusal = RefusedError(outcome.code)
                if outcome.code in _MAY_ACT and self._procedure and self._procedure.take_back:
                    self._refusal = refusal
                    self.report.write()
                    return None
                return Final(Phase.FAILED, refusal.reason)
            case Silent(reason=reason, is_sent=False) if reason == TOO_LATE:
                return self._expired()
            case Silent(is_sent=False) | Garbled(is_sent=False):
                return self._cut(Reason(ResultCode.LINE_DOWN, "write", reason=outcome.reason))
            case Silent() | Garbled():
                self.report.write()
                return None  # whether it acted is for the read-back to say
            case _:
                assert_never(outcome)

    def _expired(self) -> Final:
        """Return the end of a command whose time was over before all of it was written."""
        request = self.report.request
        if self.report.life.is_written:
            if self._outlook is LOOK:
                return self._cut(Reason(ResultCode.NOT_FOLLOWED, "overdue"))
            return self._cut(Reason(ResultCode.NOT_SEEN, "overdue"))
        age_s = request.until_s - request.received_s
        return self._cut(Reason(ResultCode.EXPIRED, "overdue", age_s=age_s))

    def _unwritten(self, procedure: Procedure, rows: Rows) -> Final:
        """Return the end of a command that has nothing to write."""
        values = self._subject(procedure, rows)
        if procedure.is_unchanged:
            return Final(Phase.CONFIRMED, Reason(ResultCode.UNCHANGED).noted(*procedure.notes), values)
        return Final(Phase.CONFIRMED, Reason(ResultCode.OK, "read"), values)

    def _confirmed(self, procedure: Procedure, values: dict[str, Any]) -> Final:
        subject = self._subject(procedure, values)
        points = {name: value for name, value in values.items() if not isinstance(value, tuple)}
        reason = Reason(ResultCode.OK, "read_back").noted(*procedure.notes)
        return Final(Phase.CONFIRMED, reason, subject, points)

    def _subject(self, procedure: Procedure, rows: Mapping[str, Any]) -> dict[str, Any]:
        """Return the rows that were read or set, as a result contains them; nothing for other commands."""
        if procedure.subjects:
            return {"values": {code: self._value(code, rows[code]) for code in procedure.subjects}}
        if procedure.subject not in rows:
            return {}
        return {"parameter": procedure.subject, **self._value(procedure.subject, rows[procedure.subject])}

    def _value(self, code: str, words: tuple[int, ...]) -> dict[str, Any]:
        contradiction = self._starter.contradiction
        if contradiction:
            return {"value": None, "unit": "", "raw": list(words), "reason": contradiction}
        row = parameters.find(self._starter.profile, code)
        decoded = decode.decode_row(self._starter.profile, self._starter.variant, row, words)
        return {
            "value": decoded.value,
            "unit": decoded.unit,
            "label": decoded.label,
            "raw": list(decoded.raw),
        }

    def _points(self, rows: Rows) -> dict[str, Any]:
        return {name: value for name, value in self._starter_io.values(rows).items() if name not in rows}

    async def _taken_back(self, end: Final, verb: str, take_back: TakeBack) -> Final:
        """Take back a start that is seen not to have acted: nothing is to let it act later."""
        self._starter_io.until_s = self.report.now_s() + LEFT_SAFE_WITHIN_S
        note = MAY_ACT_LATER
        for _ in range(MOST_TAKE_BACKS):
            if await self._starter_io.see(take_back.at_rest) is None:
                break
            if await self._is_released(verb, take_back.released):
                phase = end.phase if self._refusal is None else Phase.FAILED
                return replace(end.noted(Note("taken_back")), phase=phase)
            note = Note("not_taken_back")
        return end.noted(note)

    async def _is_released(self, verb: str, released: Expect) -> bool:
        """Take a start back in words that follow from what was just read, and return whether that shows."""
        until_s = self._starter_io.seen_s + DECIDES_FOR_S
        try:
            await self._prove_again()
            for request in self._released_by(verb):
                await self._starter_io.write(request, lane=Priority.COMMAND, until_s=until_s)
        except (CommandError, OverdueError):
            return False  # another device answers now: these are not its words; or the time is over
        return await self._starter_io.see(released) is not None

    def _released_by(self, verb: str) -> Sequence[Request]:
        return command.release(
            self._starter.profile, self._starter.variant, verb, seen=self._starter.snapshot.rows
        )

    async def _abandoned(self, end: Final) -> Final:
        """Return the end of a command that failed after its first write, once the starter is left safe."""
        if await self._leave_safe() or end.phase is not Phase.FAILED:
            return end
        return Final(Phase.UNCONFIRMED, end.reason.noted(Note("not_left_safe")))

    async def _leave_safe(self) -> bool:
        """Write what the procedure names for this case, if it was begun; return whether that was taken."""
        procedure = self._procedure
        if procedure is None or not self.report.life.is_written:
            return True
        requests = self._released_by(self.report.request.verb) if procedure.take_back else procedure.abandon
        if not requests:
            return True
        wire = StarterIo(self._starter)  # what halts the command does not halt this
        wire.until_s = self.report.now_s() + LEFT_SAFE_WITHIN_S
        try:
            await wire.wait_for(self._starter.prove(lane=Priority.COMMAND))
        except CommandError as error:
            if error.code != ResultCode.NO_ANSWER:
                return False  # another device answers now: these are not its words
        except OverdueError:
            return False
        try:
            outcomes = [await wire.write(request, lane=Priority.COMMAND) for request in requests]
        except OverdueError:
            return False
        return all(isinstance(outcome, Answered) for outcome in outcomes)


def _only_reads(procedure: Procedure) -> bool:
    return not procedure.steps and not procedure.is_unchanged
