"""Carries out one command other than a stop: read, decide, write each step once, verify, leave it safe.

1. Its slot on the line, then `decision`. That it will be written is on the disk before its first write.
2. Each write goes out once, and only while what was read still decides. Before the first one it may be
   decided again; later ones of what moves no motor go out whenever the line is free, so that it is not left
   half done.
3. A write is followed by the next only once what it brings about is seen; run = 0 must be taken.
4. Confirmed is what two readings in a row show that were asked for after the last write.
5. A start or a jog that is seen not to act is taken back by its starter's stop (`run_off`), within
   `ENDED_WITHIN_S`; where the motor cannot be seen to stand it is left alone.
6. Any other command that fails after its first write is ended as its procedure says (`abandon`). It stops
   nothing: run = 0 was seen before its other writes, and a motor that runs since then was started there.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from math import inf
from typing import Any, assert_never

from gateway.contract import CommandError, Note, Phase, Reason, ResultCode
from gateway.families import (
    Expect,
    Procedure,
    WriteStep,
    decode,
    diagnosis,
    parameters,
    reading,
)
from gateway.line import TOO_LATE, Answered, Garbled, Outcome, Priority, Refused, Silent
from gateway.modbus import ExceptionCode, exception_name
from gateway.starters.command.report import MAY_ACT_LATER, CommandReport, CommandStep, Final
from gateway.starters.command.run import ends
from gateway.starters.command.run.decision import CommandDecision, Judge
from gateway.starters.command.run.ends import Outlook
from gateway.starters.command.stop.machine import StopOrder
from gateway.starters.command.wire import HaltedError, OverdueError, RefusedError, refusal_of
from gateway.starters.identity import IdentityStatus

ENDED_WITHIN_S = 3.0  # after its deadline: taken back, or abandoned
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

RunOffBy = Callable[[CommandReport, Expect], StopOrder]  # has a starter stopped until this is seen


class _OutdatedError(Exception):
    """What was decided has not been written, and is to be decided again."""


@dataclass(eq=False)
class CommandRun:
    """One accepted command under way; `run` or else `cut` gives the command's final result."""

    judge: Judge
    slot: asyncio.Semaphore | None  # among the commands of its line, until its first write; None: none needed
    run_off: RunOffBy

    def __post_init__(self) -> None:
        self.report, self.starter, self.wire = self.judge.report, self.judge.starter, self.judge.wire
        self._held_slot = ExitStack()
        self._outlook = Outlook(self.report)
        self._cleared_s = inf  # when run = 0 was taken, as its request was asked

    async def run(self) -> None:
        """Carry the command out; HaltedError while it is taken back or abandoned."""
        self._finish(await self._ended())

    def cut(self, reason: Reason) -> None:
        """End it, whatever it is at."""
        self._finish(self._outlook.cut(reason))

    def _finish(self, end: Final) -> None:
        self._held_slot.close()
        self.judge.guard.end(is_written=self.report.is_written)
        self.report.finish(end)

    async def _ended(self) -> Final:
        """Return how the command ended, whatever came in its way; HaltedError while it is undone."""
        try:
            return await self._carried_out()
        except RefusedError as error:
            return Final(Phase.FAILED, error.reason)
        except CommandError as error:
            return self._outlook.cut(error.reason)
        except OverdueError:
            end = self._outlook.overdue()
        except HaltedError as error:
            end = self._outlook.cut(error.reason)
            if error.reason.code in ends.LEFT_ALONE:  # then nothing is written
                return end
        return await self._abandoned(end)

    async def _carried_out(self) -> Final:
        if self.slot is not None:
            await self.wire.wait_for(self.slot.acquire())
            self._held_slot.callback(self.slot.release)
        decision = await self.judge.decide()
        if decision.procedure.steps:
            # The disk first; then the line's watchdogs, the rules and the lock are judged for the last time.
            await self.wire.wait_for(self.report.intend())
            await self.wire.wait_for(self.judge.guard.admit(decision.procedure))
        while decision.procedure.steps:
            try:
                return await self._write_all(decision)
            except _OutdatedError:
                decision = await self.judge.decide()
        return ends.unwritten(decision.procedure, self._subject(decision.procedure, decision.rows))

    # Writing

    async def _write_all(self, decision: CommandDecision) -> Final:
        """Write each step once, each only after what the one before has to bring about; then read back."""
        procedure = self._outlook.procedure = decision.procedure
        for place, step in enumerate(procedure.steps, 1):
            is_last = all(later.may_be_refused for later in procedure.steps[place:])
            end = await self._take_step(decision, step, is_last=is_last)
            if end is not None:
                # After run = 0 that was not taken nothing is written: nothing was begun either.
                return end if step.is_run_off else await self._abandoned(end)
        if procedure.verify is None:
            return self._outlook.not_readable()
        values = await self.wire.see(procedure.verify)
        if values is not None:
            return ends.confirmed(procedure, self._subject(procedure, values), values)
        end = self._outlook.not_seen(procedure.verify)
        if procedure.take_back is not None:
            return await self._taken_back(end, procedure.take_back.at_rest, procedure.take_back.released)
        return await self._abandoned(end.noted(*procedure.notes))

    async def _take_step(self, decision: CommandDecision, step: WriteStep, *, is_last: bool) -> Final | None:
        """Write one step and see what it must bring about; return the end when the next must not follow."""
        outcome = await self._write(decision, step)
        is_excused = step.may_be_refused and isinstance(outcome, Refused) and outcome.code in _NOT_SET_UP
        end = None if is_excused else self._taken(decision.procedure, outcome)
        if step.is_run_off:
            return await self._run_off_taken(step, outcome, end)
        if end is not None:
            return end
        if step.then is not None:
            is_seen = await self.wire.see(step.then) is not None
            return None if is_seen else self._outlook.not_seen(step.then)
        if isinstance(outcome, Silent | Garbled) and not is_last and not step.is_silence_expected:
            return self._outlook.cut(Reason(ResultCode.NO_ANSWER, "write", reason=outcome.reason))
        return None

    async def _run_off_taken(self, step: WriteStep, outcome: Outcome, end: Final | None) -> Final | None:
        """Return the end when run = 0 was not taken: nothing that lets a run command act may follow."""
        if end is not None and not isinstance(outcome, Refused):
            return end  # it was not sent
        phase = Phase.FAILED
        if isinstance(outcome, Refused) and end is not None:
            reason = Reason(ResultCode.RUN_NOT_CLEARED, "refused", exception=exception_name(outcome.code))
        elif isinstance(outcome, Silent | Garbled):
            reason = Reason(ResultCode.NO_ANSWER, "run_off", reason=outcome.reason)
            phase = Phase.UNCONFIRMED
        else:
            self._cleared_s = min(self._cleared_s, self.wire.seen_s)
            if step.then is None or await self.wire.see(step.then) is not None:
                return None
            if isinstance(outcome, Answered) and await self.wire.is_refused(step.then.reads, _NOT_SET_UP):
                # The bit cannot be read: an acknowledged run = 0 and another look at a motor at rest suffice.
                await self.judge.look()
                return None
            point, within_s = step.then.name, step.then.within_s
            reason = Reason(ResultCode.RUN_NOT_CLEARED, "unseen", point=point, within_s=within_s)
        return Final(phase, reason.noted(Note("nothing_else")))

    async def _write(self, decision: CommandDecision, step: WriteStep) -> Outcome:
        """Send one write, once, while it may go out."""
        if step.is_silence_expected:
            setup = self.starter.setup
            self.starter.line.expect_silence(setup.address, setup.profile.timing.restart_s)
        send = self._send_later if self.report.is_written else self._send_first
        try:
            outcome = await send(decision, step)
        except (HaltedError, OverdueError):
            self.report.write()  # it may have been on its way already
            raise
        self._held_slot.close()
        return outcome

    async def _send_first(self, decision: CommandDecision, step: WriteStep) -> Outcome:
        """Send the first write; _OutdatedError when it was not sent, and there is time to decide again."""
        self.report.advance(CommandStep.WRITING)
        deadline_s = min(self.wire.until_s, self.report.request.until_s)
        until_s = min(deadline_s, decision.until_s(self.wire.seen_s))
        self.wire.until_s = until_s + decision.seen_within_s
        outcome: Outcome = Silent(TOO_LATE, is_sent=False)
        if not self._is_outdated():
            outcome = await self.wire.write(step.request, lane=self.judge.lane, until_s=until_s)
        now_s, is_unsent = self.wire.now_s(), _is_held(outcome)
        self.wire.until_s = deadline_s if is_unsent else now_s + decision.seen_within_s
        if is_unsent and now_s < deadline_s:
            raise _OutdatedError
        return outcome

    async def _send_later(self, decision: CommandDecision, step: WriteStep) -> Outcome:
        """Send a write after the first; one that may move a motor only while what was read decides.

        One that was held, because an earlier reply of its starter may still come, is handed over again.
        """
        until_s = self.wire.until_s
        if not decision.is_patient:
            until_s = min(until_s, decision.until_s(self.wire.seen_s, cleared_s=self._cleared_s))
        while decision.is_patient or not self._is_outdated():
            outcome = await self.wire.write(step.request, lane=self.judge.lane, until_s=until_s)
            if not _is_held(outcome) or self.wire.now_s() >= until_s:
                return outcome
        return Silent(TOO_LATE, is_sent=False)

    def _is_outdated(self) -> bool:
        """Return whether the gateway stood still since what was read, or since run = 0."""
        return min(self.wire.seen_s, self._cleared_s) < self.report.reporting.stood_still_s()

    def _taken(self, procedure: Procedure, outcome: Outcome) -> Final | None:
        """Record the outcome of a write; return the end when it did not go out or was refused."""
        match outcome:
            case Answered() | Refused(code=ExceptionCode.ACKNOWLEDGE):
                self.report.write()
            case Refused():
                refusal = refusal_of(self.starter.profile, outcome.code)
                if outcome.code not in _MAY_ACT or not procedure.is_motion:
                    return Final(Phase.FAILED, refusal)
                self._outlook.refusal = refusal
                self.report.write()
            case Silent(is_sent=False) if _is_held(outcome):
                return self._outlook.overdue()
            case Silent(is_sent=False) | Garbled(is_sent=False):
                return self._outlook.cut(Reason(ResultCode.LINE_DOWN, "write", reason=outcome.reason))
            case Silent() | Garbled():
                self.report.write()  # whether it acted is for the read-back to say
            case _:
                assert_never(outcome)
        return None

    # Ending

    async def _taken_back(self, end: Final, at_rest: Expect, released: Expect) -> Final:
        """Have a start taken back that is seen not to have acted; else it might act later."""
        self.wire.until_s = self.wire.now_s() + ENDED_WITHIN_S
        profile = self.starter.profile
        rows = diagnosis.distinctive_rows(profile)
        values = await self.wire.see(replace(at_rest, reads=reading.with_rows(profile, at_rest.reads, rows)))
        if values is None or self._is_another or diagnosis.contradiction(profile, values):
            return end.noted(MAY_ACT_LATER)
        self.wire.demand_not_halted()  # at shut-down nothing is written
        order = self.run_off(self.report, released)
        with suppress(OverdueError):  # the stop goes on; the command's time is over
            await self.wire.wait_for(order.over.wait())
        return self._outlook.stopped(end, is_shown=order.is_seen(self.wire.now_s()))

    async def _abandoned(self, end: Final) -> Final:
        """Return the end of a command that failed, after what its procedure leaves to be undone."""
        procedure = self._outlook.procedure
        if procedure is None or not self.report.is_written or not procedure.abandon:
            return end
        if self._is_another:
            return ends.unsafe(end)
        self.wire = self.judge.new_wire(self.wire.now_s() + ENDED_WITHIN_S)  # the other may be halted
        try:
            for request in procedure.abandon:
                outcome = await self.wire.write(request, lane=Priority.FOLLOW_UP)
                end = end if isinstance(outcome, Answered) else ends.unsafe(end)
        except OverdueError:
            return ends.unsafe(end)
        return end

    @property
    def _is_another(self) -> bool:
        """Return whether another device may answer since a silence: the procedure is not in its words."""
        return self.starter.standing.status not in (IdentityStatus.MATCHING, IdentityStatus.ASKING)

    def _subject(self, procedure: Procedure, rows: Mapping[str, Any]) -> dict[str, Any]:
        """Return the rows that were read or set, as a result contains them; nothing for other commands."""
        if procedure.subjects:
            return {"values": {code: self._value(code, rows[code]) for code in procedure.subjects}}
        if procedure.subject not in rows:
            return {}
        return {"parameter": procedure.subject, **self._value(procedure.subject, rows[procedure.subject])}

    def _value(self, code: str, words: tuple[int, ...]) -> dict[str, Any]:
        """Return a row's value; only its raw words when another device than configured may have answered."""
        starter, standing = self.starter, self.starter.standing
        if standing.contradiction or not standing.is_readable:
            why = standing.contradiction or standing.reason
            return {"value": None, "unit": "", "raw": list(words), "reason": why}
        row = parameters.find(starter.profile, code)
        said = decode.decode_row(starter.profile, starter.variant, row, words)
        return {"value": said.value, "unit": said.unit, "label": said.label, "raw": list(said.raw)}


def _is_held(outcome: Outcome) -> bool:
    """Return whether a request was not sent, because of its time or its starter's earlier replies."""
    return isinstance(outcome, Silent) and outcome.reason == TOO_LATE and not outcome.is_sent
