"""Decides what a command writes: by one judgement of a reading, and two readings that it judges alike.

1. A reading has all rows on which the command hangs; those that distinguish its family are among
   them, so that a device of another family is not written to.
2. `judge` is the one judgement: the family is right, its rules hold, the gateway's own and the operator's
   expectation hold; then the writes are built from what was read.
3. Two readings in a row must lead to the same writes, the gateway not having stood still since the first.
4. What was decided is written within `DECIDES_FOR_S` of its reading, `WAITS_FOR_S` where no motor can move.
"""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf
from typing import Any

from gateway.contract import READ, CommandError, CommandRequest, ResultCode
from gateway.families import Preparation, Procedure, command, diagnosis
from gateway.line import Priority
from gateway.starters.command.report import CommandReport, CommandStep
from gateway.starters.command.wire import DECIDES_FOR_S, LAST_READING_S, Rows, Wire, points_of
from gateway.starters.identity import IdentityStatus, not_matching
from gateway.starters.policy.policy import Guard
from gateway.starters.starter import StarterTelemetry

CAN_WAIT = frozenset({"read", "set", "configure", "output"})  # verbs that move no motor

WAITS_FOR_S = 10.0  # DECIDES_FOR_S of what moves no motor, and may wait for the line
CLEARS_FOR_S = 5.0  # after run = 0: later the same procedure changes no command source
LATER_STEP_S = 2.0  # the line may take so long for each write after the first
ASKED_AGAIN_S = 0.2  # after a reply that was lost
MOST_READINGS = 4  # until two in a row agree


def judge(
    request: CommandRequest,
    starter: StarterTelemetry,
    preparation: Preparation,
    guard: Guard,
    *,
    known: Mapping[str, tuple[int, ...]],
    points: Mapping[str, Any],
) -> Procedure | None:
    """Return the writes that follow from the rows that the command reads, None when some are not known.

    CommandError when a rule forbids them, the family's or the gateway's own (`guard`).
    """
    codes = {code for read in preparation.reads for code in read.codes}
    rows = {code: words for code, words in known.items() if code in codes}
    if request.verb != READ:  # which does no harm, in whatever words
        demand_identified(request, starter)
        if why := diagnosis.contradiction(starter.profile, rows):
            raise not_matching(IdentityStatus.MISMATCHED, why)
    decisive = {**rows, **points}  # a rule may hang on a raw row
    command.demand(starter.profile, preparation.requires, decisive, variant=starter.variant)
    guard.check(points)
    if rows.keys() != codes:
        return None
    return command.build(starter.profile, starter.variant, request.verb, request.args, seen=rows)


def demand_identified(request: CommandRequest, starter: StarterTelemetry) -> None:
    """Demand that the starter is online and as configured; of another one the raw words may be read."""
    if not starter.is_answering:
        raise CommandError(ResultCode.OFFLINE, "starter")
    standing, status = starter.standing, starter.standing.status
    is_raw = request.verb == READ and (standing.contradiction or status is IdentityStatus.OTHER_SLOT)
    if status is not IdentityStatus.MATCHING and not is_raw:
        raise not_matching(status, standing.reason)


@dataclass(frozen=True, slots=True)
class CommandDecision:
    """The writes that follow from a reading, that reading, and how long it decides."""

    procedure: Procedure
    rows: Rows
    is_patient: bool  # no write of it can move a motor

    def until_s(self, seen_s: float, *, cleared_s: float = inf) -> float:
        """Return until when a write may go out that rests on rows which were asked for at `seen_s`.

        `cleared_s` is when run = 0 was taken.
        """
        return min(seen_s + (WAITS_FOR_S if self.is_patient else DECIDES_FOR_S), cleared_s + CLEARS_FOR_S)

    @property
    def seen_within_s(self) -> float:
        """Return how long after its first write the whole command is to be seen: the family's times."""
        expected = (*(step.then for step in self.procedure.steps), self.procedure.verify)
        seen_s = sum(expect.within_s for expect in expected if expect is not None)
        return seen_s + LATER_STEP_S * (len(self.procedure.steps) - 1) + LAST_READING_S


@dataclass(slots=True)
class Judge:
    """Reads and decides for one command; what is read distinguishes its family as well."""

    report: CommandReport
    starter: StarterTelemetry
    preparation: Preparation
    guard: Guard
    lane: Priority = field(init=False)
    wire: Wire = field(init=False)

    def __post_init__(self) -> None:
        if self.report.request.verb != READ:
            self.preparation = diagnosis.with_distinctive_rows(self.starter.profile, self.preparation)
        can_wait = self.report.request.verb in CAN_WAIT
        self.lane = Priority.PARAMETERS if can_wait else Priority.COMMAND
        self.wire = self.new_wire(self.report.request.until_s)

    def new_wire(self, until_s: float) -> Wire:
        """Return a way to the starter, which ends at that time."""
        return Wire(self.starter, until_s=until_s, read_back_lane=max(self.lane, Priority.READ_BACK))

    async def decide(self) -> CommandDecision:
        """Return what to do; CommandError when a rule forbids it or the readings disagree, RefusedError."""
        self.report.advance(CommandStep.READING)
        earlier: Procedure | None = None
        earlier_s = -inf
        for _ in range(MOST_READINGS):
            decision = await self.look()
            procedure = decision.procedure
            is_enough = not self.preparation.reads or not (procedure.steps or procedure.is_unchanged)
            is_alike = procedure == earlier and earlier_s >= self.report.reporting.stood_still_s()
            if is_enough or is_alike:
                self.report.advance(CommandStep.DECIDED)
                return decision
            earlier, earlier_s = procedure, self.wire.seen_s
        raise CommandError(ResultCode.READINGS_DISAGREE)

    async def look(self) -> CommandDecision:
        """Return what one reading leads to; CommandError when a rule forbids it, RefusedError."""
        rows, request = await self._read(), self.report.request
        points = points_of(self.wire.values(rows))
        if not self.report.is_written:
            self.report.before = points
        procedure = judge(request, self.starter, self.preparation, self.guard, known=rows, points=points)
        assert procedure is not None  # all rows were read
        return CommandDecision(procedure, rows, request.verb in CAN_WAIT and not procedure.is_source)

    async def _read(self) -> Rows:
        """Read, and again after each lost reply, as long as the starter is online."""
        while True:
            try:
                return await self.wire.read(self.preparation.reads, lane=self.lane)
            except CommandError as error:
                if error.code != ResultCode.NO_ANSWER or not self.starter.is_answering:
                    raise
            await self.wire.wait_for(asyncio.sleep(ASKED_AGAIN_S))
