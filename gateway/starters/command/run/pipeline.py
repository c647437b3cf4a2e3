"""Carries out one command other than a stop: read, decide, write each step once, verify, take back.

1. Its slot on the line, then `decision`. That it will be written is on the disk before its first write.
2. Each write goes out once, and only while what was read still decides. Before the first one it may be
   decided again; later ones of what moves no motor go out whenever the line is free, so that it is not left
   half done.
3. A write is followed by the next only once what it brings about is seen; run = 0 must be taken.
4. Confirmed is what two readings in a row show that were asked for after the last write.
5. A start or a jog that is seen not to act is taken back by its starter's stop (`take_back`), within
   `TAKEN_BACK_WITHIN_S`; where the motor cannot be seen to stand it is left alone.
6. Any other command that fails after its first write leaves the starter as its procedure says (`abandon`).
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from math import inf
from typing import Any, Protocol, assert_never

from gateway.contract import CommandError, Phase, Reason, ResultCode
from gateway.families import (
    Preparation,
    Procedure,
    WriteStep,
    decode,
    diagnosis,
    parameters,
    reading,
)
from gateway.line import TOO_LATE, Answered, Garbled, Outcome, Priority, Refused, Silent
from gateway.modbus.codes import ExceptionCode, exception_name
from gateway.starters.command.report import CommandReport, Final
from gateway.starters.command.run import ends
from gateway.starters.command.run.decision import CommandDecision, Judge
from gateway.starters.command.run.ends import Outlook
from gateway.starters.command.steps import CommandStep
from gateway.starters.command.wire import LAST_READING_S, HaltedError, OverdueError, RefusedError, Wire
from gateway.starters.identity import IdentityStatus
from gateway.starters.known_watchdogs import KnownWatchdogs
from gateway.starters.policy.preconditions import Guard
from gateway.starters.view import StarterIo

logger = logging.getLogger(__name__)

CAN_WAIT = frozenset({"read", "set", "configure", "output"})  # verbs that move no motor
LATER_STEP_S = 2.0  # the line may take so long for each write after the first
TAKEN_BACK_WITHIN_S = 3.0  # after its deadline a start is taken back, or the starter left safe
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


class TakingBack(Protocol):
    """A start or jog that the starter's stop takes back."""

    async def ended(self) -> None:
        """Return once both commands were read as 0 after an acknowledged frame, or the stop gave up."""

    def is_shown(self) -> bool:
        """Return whether the latest two readings show them as 0 in remote mode, with the motor at rest."""


TakeBackBy = Callable[[CommandReport, Procedure], TakingBack]


class _OutdatedError(Exception):
    """What was decided has not been written, and is to be decided again."""


class CommandRun:
    """One accepted command under way; `run` always ends with the command's final result."""

    def __init__(
        self,
        report: CommandReport,
        starter: StarterIo,
        preparation: Preparation,
        guard: Guard | None = None,
        *,
        slot: asyncio.Semaphore | None = None,
        watchdogs: KnownWatchdogs | None = None,
        take_back: TakeBackBy | None = None,
    ) -> None:
        self.report = report
        self._starter = starter
        self._guard = guard
        self._slot = slot  # among the commands of its line, until its first write; None: it does not wait
        self._has_slot = False
        self._watchdogs = watchdogs or KnownWatchdogs()  # of the starters that share its line
        self._take_back = take_back  # None: a start is left alone
        self.can_wait = report.request.verb in CAN_WAIT
        self._lane = Priority.PARAMETERS if self.can_wait else Priority.COMMAND
        back = Priority.PARAMETERS if self.can_wait else Priority.READ_BACK
        self._wire = Wire(starter, read_back_lane=back)
        self._wire.until_s = report.request.until_s
        self._judge = Judge(report, starter, preparation, guard, wire=self._wire, lane=self._lane)
        self._outlook = Outlook(report.request.verb, self.can_wait)
        self._cleared_s = inf  # when run = 0 was taken, as its request was asked

    @property
    def line(self) -> str:
        """The name of its starter's line."""
        return self._starter.setup.line

    def halt(self, reason: Reason) -> None:
        """Let nothing more of this command go out."""
        self._wire.halt(reason)

    async def run(self) -> None:
        """Carry the command out; never raises."""
        try:
            end = await self._ended()
        except Exception:  # the guard at the task's top
            logger.exception("starter=%s command ended by a bug", self.report.request.starter)
            end = self._cut(Reason(ResultCode.INTERNAL))
        self._leave_slot()
        self._watchdogs.end(self.report.request.starter)
        self.report.finish(end)

    async def _ended(self) -> Final:
        """Return how the command ended, whatever came in its way."""
        try:
            return await self._carried_out()
        except CommandError as error:
            return self._cut(error.reason)
        except RefusedError as error:
            return Final(Phase.FAILED, error.reason)
        except OverdueError:
            await self._leave_safe()
            return self._overdue()
        except HaltedError as error:
            if error.reason.code != ResultCode.SHUTTING_DOWN:  # nothing is written at shut-down
                await self._leave_safe()
            return self._cut(error.reason)

    async def _carried_out(self) -> Final:
        if self._slot is not None:
            await self._wire.wait_for(self._slot.acquire())
            self._has_slot = True
        decision = await self._judge.decide()
        if decision.procedure.steps:
            await self._intend(decision.procedure)
        while decision.procedure.steps:
            try:
                return await self._write_all(decision)
            except _OutdatedError:
                decision = await self._judge.decide()
        return ends.unwritten(decision.procedure, self._subject(decision.procedure, decision.rows))

    async def _intend(self, procedure: Procedure) -> None:
        """Have it admitted, and stored that something is about to be written; CommandError when it is not."""
        await self._wire.wait_for(self._watchdogs.admit(self.report.request.starter, procedure))
        await self._wire.wait_for(self.report.intend())
        if self._guard is not None:
            await self._wire.wait_for(self._guard.admit())
        self.report.count_memory_writes(procedure.wears)

    # Writing

    async def _write_all(self, decision: CommandDecision) -> Final:
        """Write each step once, each only after what the one before has to bring about; then read back."""
        procedure = decision.procedure
        self._outlook = replace(self._outlook, procedure=procedure)
        for place, step in enumerate(procedure.steps, 1):
            is_last = all(later.may_be_refused for later in procedure.steps[place:])
            end = await self._take_step(decision, step, is_last=is_last)
            if end is not None:
                # After run = 0 that was not taken, and after a start, nothing is to be undone.
                is_left = step.is_run_off or procedure.take_back is not None
                return end if is_left else await self._abandoned(end)
        if procedure.verify is None:
            return self._outlook.not_readable()
        values = await self._wire.see(procedure.verify)
        if values is not None:
            return ends.confirmed(procedure, self._subject(procedure, values), values)
        end = self._outlook.not_seen(procedure.verify)
        if procedure.take_back is not None:
            return await self._taken_back(end, procedure)
        return await self._abandoned(end.noted(*procedure.notes))

    async def _take_step(self, decision: CommandDecision, step: WriteStep, *, is_last: bool) -> Final | None:
        """Write one step and see what it must bring about; return the end when the next must not follow."""
        outcome = await self._write(decision, step)
        is_excused = step.may_be_refused and isinstance(outcome, Refused) and outcome.code in _NOT_SET_UP
        end = None if is_excused else self._taken(outcome)
        if step.is_run_off:
            return await self._run_off(step, outcome, end, is_excused=is_excused)
        if end is not None:
            return end
        if step.then is not None:
            is_seen = await self._wire.see(step.then) is not None
            return None if is_seen else self._outlook.not_seen(step.then)
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
            return ends.run_not_cleared(reason, Phase.FAILED)
        if end is not None:
            return end
        self._cleared_s = min(self._cleared_s, self._wire.seen_s)
        if not is_excused and not isinstance(outcome, (Answered, Refused)):
            reason = Reason(ResultCode.NO_ANSWER, "run_off", reason=outcome.reason)
            return ends.run_not_cleared(reason, Phase.UNCONFIRMED)
        if step.then is None or await self._wire.see(step.then) is not None:
            return None
        if isinstance(outcome, Answered) and await self._wire.is_refused(step.then.reads, _NOT_SET_UP):
            # A starter that does not let the bit be read: the acknowledgement and the standstill suffice.
            await self._judge.demand_again()
            return None
        point, within_s = step.then.name, step.then.within_s
        reason = Reason(ResultCode.RUN_NOT_CLEARED, "unseen", point=point, within_s=within_s)
        return ends.run_not_cleared(reason, Phase.FAILED)

    async def _write(self, decision: CommandDecision, step: WriteStep) -> Outcome:
        """Send one write, once, while it may go out."""
        if step.is_silence_expected:
            setup = self._starter.setup
            self._starter.line.expect_silence(setup.address, setup.profile.timing.restart_s)
        is_first = not self.report.life.is_written
        try:
            outcome = await (self._send_first if is_first else self._send_later)(decision, step)
        except (HaltedError, OverdueError):
            self.report.write()  # it may have been on its way already
            raise
        self._leave_slot()
        return outcome

    async def _send_first(self, decision: CommandDecision, step: WriteStep) -> Outcome:
        """Send the first write; _OutdatedError when it was not sent, and there is time to decide again."""
        self.report.life.advance(CommandStep.WRITING)
        deadline_s = min(self._wire.until_s, self.report.request.until_s)
        until_s = min(deadline_s, decision.until_s(self._wire.seen_s, can_wait=self.can_wait))
        self._wire.until_s = until_s + self._seen_within_s(decision.procedure)
        outcome = await self._send(step, until_s)
        is_unsent = isinstance(outcome, Silent) and outcome.reason == TOO_LATE and not outcome.is_sent
        now_s = self.report.now_s()
        self._wire.until_s = deadline_s if is_unsent else now_s + self._seen_within_s(decision.procedure)
        if is_unsent and now_s < deadline_s:
            raise _OutdatedError
        return outcome

    async def _send_later(self, decision: CommandDecision, step: WriteStep) -> Outcome:
        """Send a write after the first; one that chooses who commands the motor only while that is safe."""
        if self.can_wait and not decision.procedure.is_source:
            return await self._wire.write(step.request, lane=self._lane)
        until_s = decision.until_s(self._wire.seen_s, cleared_s=self._cleared_s, can_wait=self.can_wait)
        return await self._send(step, min(until_s, self._wire.until_s))

    async def _send(self, step: WriteStep, until_s: float) -> Outcome:
        if self.report.is_outdated(min(self._wire.seen_s, self._cleared_s)):
            return Silent(TOO_LATE, is_sent=False)
        return await self._wire.write(step.request, lane=self._lane, until_s=until_s)

    def _seen_within_s(self, procedure: Procedure) -> float:
        """Return how long after its first write the whole command is to be seen: the family's times."""
        expected = (*(step.then for step in procedure.steps), procedure.verify)
        seen_s = sum(expect.within_s for expect in expected if expect is not None)
        return seen_s + LATER_STEP_S * (len(procedure.steps) - 1) + LAST_READING_S

    def _taken(self, outcome: Outcome) -> Final | None:
        """Record the outcome of a write; return the end when it did not go out or was refused."""
        match outcome:
            case Answered() | Refused(code=ExceptionCode.ACKNOWLEDGE):
                self.report.write()
                return None
            case Refused():
                refusal = RefusedError(self._starter.profile, outcome.code).reason
                procedure = self._outlook.procedure
                if outcome.code in _MAY_ACT and procedure and procedure.take_back:
                    self._outlook = replace(self._outlook, refusal=refusal)
                    self.report.write()
                    return None
                return Final(Phase.FAILED, refusal)
            case Silent(reason=reason, is_sent=False) if reason == TOO_LATE:
                return self._overdue()
            case Silent(is_sent=False) | Garbled(is_sent=False):
                return self._cut(Reason(ResultCode.LINE_DOWN, "write", reason=outcome.reason))
            case Silent() | Garbled():
                self.report.write()
                return None  # whether it acted is for the read-back to say
            case _:
                assert_never(outcome)

    def _leave_slot(self) -> None:
        if self._slot is not None and self._has_slot:
            self._has_slot = False
            self._slot.release()

    # Ending

    async def _taken_back(self, end: Final, procedure: Procedure) -> Final:
        """Have a start taken back that is seen not to have acted; else it might act later."""
        self._wire.until_s = self.report.now_s() + TAKEN_BACK_WITHIN_S
        if self._take_back is None or not await self._is_seen_at_rest(procedure):
            return end.noted(ends.MAY_ACT_LATER)
        self._wire.demand_not_halted()  # at shut-down nothing is written
        taking_back = self._take_back(self.report, procedure)
        with suppress(OverdueError):  # the stop goes on; the command's time is over
            await self._wire.wait_for(taking_back.ended())
        return self._outlook.taken_back(end, is_released=taking_back.is_shown())

    async def _is_seen_at_rest(self, procedure: Procedure) -> bool:
        """Return whether two readings, made like those that decided, show the motor at rest."""
        profile = self._starter.profile
        if procedure.take_back is None:
            return False
        at_rest = procedure.take_back.at_rest
        rows = diagnosis.distinctive_rows(profile)
        values = await self._wire.see(replace(at_rest, reads=reading.with_rows(profile, at_rest.reads, rows)))
        return values is not None and not self._is_another and not diagnosis.contradiction(profile, values)

    @property
    def _is_another(self) -> bool:
        """Return whether another device may answer since a silence: the procedure is not in its words."""
        return self._starter.identity_standing not in (IdentityStatus.MATCHING, IdentityStatus.ASKING)

    async def _abandoned(self, end: Final) -> Final:
        """Return the end of a command that failed after its first write, once the starter is left safe."""
        return end if await self._leave_safe() else ends.not_left_safe(end)

    async def _leave_safe(self) -> bool:
        """Write what the procedure names for this case, if it was begun; return whether that was taken."""
        procedure = self._outlook.procedure
        if procedure is None or not self.report.life.is_written:
            return True
        if procedure.abandon and self._is_another:
            return False
        wire = Wire(self._starter)  # what halts the command does not halt this
        wire.until_s = self.report.now_s() + TAKEN_BACK_WITHIN_S
        try:
            outcomes = [await wire.write(request, lane=Priority.COMMAND) for request in procedure.abandon]
        except OverdueError:
            return False
        return all(isinstance(outcome, Answered) for outcome in outcomes)

    def _cut(self, reason: Reason) -> Final:
        return self._outlook.cut(reason, is_written=self.report.life.is_written)

    def _overdue(self) -> Final:
        request = self.report.request
        age_s = request.until_s - request.received_s
        return self._outlook.overdue(age_s=age_s, is_written=self.report.life.is_written)

    def _subject(self, procedure: Procedure, rows: Mapping[str, Any]) -> dict[str, Any]:
        """Return the rows that were read or set, as a result contains them; nothing for other commands."""
        if procedure.subjects:
            return {"values": {code: self._value(code, rows[code]) for code in procedure.subjects}}
        if procedure.subject not in rows:
            return {}
        return {"parameter": procedure.subject, **self._value(procedure.subject, rows[procedure.subject])}

    def _value(self, code: str, words: tuple[int, ...]) -> dict[str, Any]:
        """Return a row's value; of a device that contradicts the configuration only its raw words."""
        why = self._starter.contradiction
        if why:
            return {"value": None, "unit": "", "raw": list(words), "reason": why}
        row = parameters.find(self._starter.profile, code)
        said = decode.decode_row(self._starter.profile, self._starter.variant, row, words)
        return {"value": said.value, "unit": said.unit, "label": said.label, "raw": list(said.raw)}
