"""Decides what a command writes: by one judgement of a reading, and two readings that it judges alike.

1. A reading has all rows on which the command hangs; those that distinguish its family are among
   them, so that a device of another family is not written to.
2. `judge` is the one judgement: the family is right, its rules hold, the gateway's own and the operator's
   expectation hold; then the writes are built from what was read.
3. Two readings in a row must lead to the same writes. A poll of the last `DECIDES_FOR_S` is as good as the
   first of them, unless the gateway stood still since.
4. What was decided is written within `DECIDES_FOR_S` of its reading, `WAITS_FOR_S` where no motor can move.
"""

from __future__ import annotations

from collections.abc import Callable, Coroutine
from dataclasses import dataclass
from math import inf
from typing import Any, TypeVar

from gateway.contract import READ, CommandError, ResultCode
from gateway.families import Preparation, Procedure, command, diagnosis
from gateway.line import Priority
from gateway.starters.command.report import CommandReport
from gateway.starters.command.steps import CommandStep
from gateway.starters.command.wire import Rows, Wire
from gateway.starters.identity import IdentityStatus, not_matching
from gateway.starters.policy.preconditions import Guard
from gateway.starters.view import StarterIo

T = TypeVar("T")

DECIDES_FOR_S = 2.0  # after that much can have happened at a motor
WAITS_FOR_S = 10.0  # the same for what moves no motor, and may wait for the line
CLEARS_FOR_S = 5.0  # after run = 0: then who commands the motor is changed no more by the same procedure
MOST_READINGS = 4  # until two in a row agree
ASKED_AGAIN_S = 0.5  # after this a starter that did not answer is asked again, while the command has time


@dataclass(frozen=True, slots=True)
class CommandDecision:
    """The writes that follow from a reading, and that reading."""

    procedure: Procedure
    rows: Rows

    def until_s(self, seen_s: float, *, cleared_s: float = inf, can_wait: bool) -> float:
        """Return until when a write may go out that rests on rows which were asked for at `seen_s`.

        `can_wait`: its verb moves no motor. `cleared_s` is when run = 0 was taken.
        """
        is_patient = can_wait and not self.procedure.is_source
        return min(seen_s + (WAITS_FOR_S if is_patient else DECIDES_FOR_S), cleared_s + CLEARS_FOR_S)


class Judge:
    """Reads and decides for one command."""

    def __init__(
        self,
        report: CommandReport,
        starter: StarterIo,
        preparation: Preparation,
        guard: Guard | None,
        *,
        wire: Wire,
        lane: Priority,
    ) -> None:
        self._report = report
        self._starter = starter
        self._preparation = preparation
        self._guard = guard  # what the gateway itself demands
        self._wire = wire
        self._lane = lane

    async def decide(self) -> CommandDecision:
        """Return what to do; CommandError when a rule forbids it or the readings disagree, RefusedError."""
        self._report.life.advance(CommandStep.READING)
        earlier = self._judge_polls()
        for _ in range(MOST_READINGS):
            rows = await self._insist(lambda: self._wire.read(self._preparation.reads, lane=self._lane))
            self._report.before = self._points(rows)
            procedure = self.judge(rows)
            is_enough = not self._preparation.reads or _only_reads(procedure)
            if is_enough or procedure == earlier:
                self._report.life.advance(CommandStep.DECIDED)
                return CommandDecision(procedure, rows)
            earlier = procedure
        raise CommandError(ResultCode.READINGS_DISAGREE)

    def judge(self, rows: Rows) -> Procedure:
        """Return the writes that follow from these rows; CommandError when a rule forbids them."""
        profile, request = self._starter.profile, self._report.request
        points = self._points(rows)
        if request.verb != READ:  # which does no harm, in whatever words
            self._demand_identity(rows)
        self._demand_rules(rows)
        if self._guard is not None:
            self._guard.check(points)
        return command.build(profile, self._starter.variant, request.verb, request.args, seen=rows)

    def _demand_identity(self, rows: Rows) -> None:
        """Demand that the configured device answers, and that none of these rows denies it."""
        if not self._starter.is_answering:
            raise CommandError(ResultCode.OFFLINE, "starter")
        status = self._starter.identity_standing
        if status is not IdentityStatus.MATCHING:
            raise not_matching(status, self._starter.identity_reason)
        if why := diagnosis.contradiction(self._starter.profile, rows):
            raise not_matching(IdentityStatus.MISMATCHED, why)

    async def demand_again(self) -> None:
        """Read once more; CommandError unless the family's rules hold still."""
        rows = await self._wire.read(self._preparation.reads, lane=self._lane)
        self._demand_identity(rows)
        self._demand_rules(rows)

    def _demand_rules(self, rows: Rows) -> None:
        starter = self._starter
        values = self._wire.values(rows)
        command.demand(starter.profile, self._preparation.requires, values, variant=starter.variant)

    def _judge_polls(self) -> Procedure | None:
        """Return what the last polls lead to; None when they are too old, lack a row or forbid it."""
        since_s = self._report.now_s() - DECIDES_FOR_S
        if self._report.is_outdated(since_s):
            return None  # some of it may have been read before the gateway stood still
        recent = self._starter.snapshot.rows_since(since_s)
        codes = {code for read in self._preparation.reads for code in read.codes}
        codes -= set(diagnosis.distinctive_rows(self._starter.profile))  # they are in the second reading
        if not codes <= recent.keys():
            return None
        try:
            return self.judge({code: recent[code] for code in codes})
        except CommandError:
            return None

    async def _insist(self, ask: Callable[[], Coroutine[Any, Any, T]]) -> T:
        """Ask until that is answered, as long as the starter is online."""
        while True:
            try:
                return await ask()
            except CommandError as error:
                if error.code != ResultCode.NO_ANSWER or not self._starter.is_answering:
                    raise
            await self._wire.pause(ASKED_AGAIN_S)

    def _points(self, rows: Rows) -> dict[str, Any]:
        return {name: value for name, value in self._wire.values(rows).items() if name not in rows}


def _only_reads(procedure: Procedure) -> bool:
    return not procedure.steps and not procedure.is_unchanged
