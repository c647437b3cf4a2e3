"""Stops one starter: written again and again, before everything else, until read back or its time is up."""

from __future__ import annotations

import asyncio
import logging
from dataclasses import replace
from typing import Any, assert_never

from gateway.families.command import build
from gateway.families.procedure import Procedure
from gateway.line.job import Lane
from gateway.line.outcome import Answered, Garbled, Outcome, Refused, Silent
from gateway.modbus.pdu import Request
from gateway.starters.addressed import Addressed
from gateway.starters.conduct import HALTED, MAY_BE_TURNING
from gateway.starters.control import StarterControlView
from gateway.starters.errand import End, Errand
from gateway.starters.records import Phase, Severity
from gateway.starters.request import CommandRequest
from gateway.starters.wire import EQUAL_READINGS, READ_BACK_PAUSE_S, HaltedError, RefusedError, Wire

logger = logging.getLogger(__name__)

DEADLINE_S = 10.0
REPEAT_S = 0.5


class Stopping:
    """One starter's stop under way; every stop command that comes meanwhile joins it."""

    def __init__(self, starter: StarterControlView) -> None:
        self._starter = Addressed(starter)
        self._wire = Wire(self._starter)
        self._errands: list[Errand] = []
        self._deadline_s = 0.0
        self._is_written = False
        self._is_taken = False  # the starter acknowledged a stop
        self._is_answered = False  # it answered anything at all since
        self._refusal: RefusedError | None = None

    def begin(self) -> None:
        """Hand the first write to the line, before anything else is done about this stop."""
        self.extend()
        try:
            self._wire.begin_write(self._procedure().steps[0].request, lane=Lane.STOP)
        except Exception:  # whatever it is, `run` meets it again and ends the commands
            logger.exception("starter=%s stop not begun; it is tried once more", self._starter.setup.name)

    def join(self, errand: Errand) -> None:
        """Take in one more stop command, already accepted; the deadline is the last one's."""
        self._errands.append(errand)
        self.extend()
        errand.before = self._starter.snapshot.good_values()
        if self._is_written:
            errand.write()

    def extend(self) -> None:
        """Go on as long as if it had just been asked for."""
        self._deadline_s = asyncio.get_running_loop().time() + DEADLINE_S

    def is_asked_for(self, request: CommandRequest) -> bool:
        """Return whether the same client's stop, which its answer cannot be told apart from, has joined."""
        if request.id or request.correlation:
            return False
        known = ((errand.request.client, errand.request.id) for errand in self._errands)
        return (request.client, request.id) in known

    @property
    def count(self) -> int:
        """Return how many stop commands have joined."""
        return len(self._errands)

    def halt(self, code: str) -> None:
        """Let nothing more go out."""
        self._wire.halt(code)

    async def run(self) -> None:
        """Stop the motor; never raises, and always ends every stop command that has joined."""
        try:
            end = await self._ended()
        except Exception:  # the guard at the task's top
            logger.exception("starter=%s stop ended by a bug", self._starter.setup.name)
            end = self._cut("internal", "an error inside the gateway; see its log")
        if self._starter.note:
            end = replace(end, text=f"{end.text}; {self._starter.note}")
        if end.phase is not Phase.CONFIRMED:
            self._call_a_person(end)
        for errand in self._errands:
            errand.finish(end)

    async def _ended(self) -> End:
        loop = asyncio.get_running_loop()
        next_write_s, count = loop.time(), 0
        try:
            while True:
                if loop.time() >= next_write_s and (count == 0 or not self._is_taken):
                    next_write_s = loop.time() + REPEAT_S
                    count = await self._write(count)
                values = await self._see_stopped()
                count = 0 if values is None else count + 1
                is_over = loop.time() >= self._deadline_s
                if values is not None and count >= EQUAL_READINGS and (self._is_taken or is_over):
                    return End(Phase.CONFIRMED, "ok", "read back from the starter", after=_points(values))
                if is_over and count == 0:
                    return self._unseen()
                await self._wire.pause(READ_BACK_PAUSE_S)
        except HaltedError as error:
            return self._cut(error.code, HALTED.get(error.code, error.code))

    async def _write(self, count: int) -> int:
        """Write the stop once; return how many of the readings so far still count.

        A starter that has not acknowledged the stop may yet carry out an earlier start.
        """
        was_taken = self._is_taken
        outcomes = [await self._send(step.request) for step in self._procedure().steps]
        self._is_taken = was_taken or all(isinstance(outcome, Answered) for outcome in outcomes)
        return count if was_taken or not self._is_taken else 0

    async def _send(self, request: Request) -> Outcome:
        try:
            outcome = await self._wire.write(request, lane=Lane.STOP)
        except HaltedError:
            self._note_written()  # it may have been on its way already
            raise
        self._is_answered = self._is_answered or isinstance(outcome, (Answered, Refused))
        match outcome:
            case Refused():
                self._refusal = RefusedError(outcome.code)
            case Silent(is_sent=False) | Garbled(is_sent=False):
                pass
            case Answered() | Silent() | Garbled():
                self._note_written()
            case _:
                assert_never(outcome)
        return outcome

    def _procedure(self) -> Procedure:
        """Return what stops the starter, from the rows known last, however old."""
        starter = self._starter
        return build(starter.profile, starter.variant, "stop", {}, seen=starter.snapshot.rows)

    async def _see_stopped(self) -> dict[str, Any] | None:
        """Return what was read if it shows that the motor stops, else None."""
        expect = self._procedure().verify
        rows = None if expect is None else await self._wire.read_back(expect.reads)
        if expect is None or rows is None:
            return None
        self._is_answered = True
        values = self._wire.values(rows)
        return values if expect.is_met(values) else None

    def _note_written(self) -> None:
        self._is_written = True
        for errand in self._errands:
            errand.write()

    def _unseen(self) -> End:
        """Return the end of a stop whose time is up."""
        if self._is_written and not self._is_answered:
            text = f"the starter did not answer for {DEADLINE_S:g} s, neither the stop nor a reading"
            return End(Phase.UNCONFIRMED, "no_answer", f"{text}: {MAY_BE_TURNING}")
        if self._is_written:
            text = f"the motor was not seen to stop within {DEADLINE_S:g} s: {MAY_BE_TURNING}"
            return End(Phase.UNCONFIRMED, "not_seen", text)
        if self._refusal is not None:
            return End(Phase.FAILED, self._refusal.code, f"{self._refusal}: {MAY_BE_TURNING}")
        return self._cut("line_down", "the stop could not be sent")

    def _cut(self, code: str, text: str) -> End:
        if self._is_written:
            return End(Phase.UNCONFIRMED, code, f"{text}; a stop was written before: {MAY_BE_TURNING}")
        phase = Phase.FAILED if code == "internal" else Phase.REJECTED
        return End(phase, code, f"{text}: {MAY_BE_TURNING}")

    def _call_a_person(self, end: End) -> None:
        logger.error("starter=%s stop not confirmed: %s", self._starter.setup.name, end.text)
        data = {"phase": end.phase, "code": end.code}
        self._starter.publisher.event("stop_unconfirmed", Severity.ERROR, end.text, data)


def _points(values: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in values.items() if not isinstance(value, tuple)}
