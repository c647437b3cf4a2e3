"""A scheduler under test: asked step by step, or on a line where each transaction takes as long as given."""

from __future__ import annotations

import random
from collections import defaultdict
from collections.abc import Callable, Iterable
from math import inf

from gateway.line.rtu.transaction import Answered, Garbled, Outcome, Silent, reply_within_s, request_wire_s
from gateway.line.scheduler.requests import Job, Poll, Priority, Slot
from gateway.line.scheduler.scheduler import Scheduler
from gateway.modbus.pdu import Request
from gateway.modbus.reads import ReadHoldingRegisters
from gateway.modbus.timing import LineTiming
from gateway.modbus.writes import WriteRegister

READ = ReadHoldingRegisters(0, 1)
WRITE = WriteRegister(1, 2)
ANSWERED = Answered((1,), at_s=0.0, response_time_s=0.005)
GARBLED = Garbled("bad CRC", b"\x01")


def job(lane: Priority = Priority.COMMAND, unit: int = 1, request: Request = WRITE) -> Job:
    return Job(unit, request, 0.01, lane, lambda outcome: None)


class NoChance(random.Random):
    """Leaves every phase at a whole period, every pause as it is."""

    def random(self) -> float:
        return 1.0

    def uniform(self, a: float, b: float) -> float:
        return (a + b) / 2


def begun(*polls: Poll, chance: random.Random | None = None) -> Scheduler:
    scheduler = Scheduler(polls, chance=chance or NoChance())
    scheduler.polls.begin(0.0)
    return scheduler


def cost_s(poll: Poll, timing: LineTiming, *, allowance_s: float = 0.0) -> float:
    """Return what an answered poll takes of the line at most."""
    within_s = reply_within_s(
        poll.request, timing, response_time_s=poll.response_time_s, allowance_s=allowance_s
    )
    return timing.silence_s + request_wire_s(poll.request, timing) + within_s


class IdealLine:
    """Serves a scheduler; `took_s` says what a slot takes, `outcome_of` what becomes of it."""

    def __init__(
        self,
        polls: Iterable[Poll],
        took_s: Callable[[Slot], float],
        outcome_of: Callable[[Slot, float], Outcome] | None = None,
        *,
        seed: int = 0,
    ) -> None:
        self.polls = tuple(polls)
        self.scheduler = Scheduler(self.polls, chance=random.Random(seed))
        self.scheduler.polls.begin(0.0)
        self.now_s = 0.0
        self.slots: list[tuple[float, Slot]] = []  # when each began
        self.answered_s: dict[str, float] = {}
        self.gaps_s: defaultdict[str, list[float]] = defaultdict(list)  # between two answers of a poll
        self.served_s: dict[int, float] = {}  # the start of the latest request that a unit was reached by
        self.unserved_s: defaultdict[int, float] = defaultdict(float)  # the longest time between two of those
        self._took_s = took_s
        self._outcome_of = outcome_of or (lambda slot, at_s: Answered((), at_s, 0.0))

    def step(self, until_s: float = inf) -> Slot | None:
        """Do one slot, or wait for the next, at most until then."""
        slot = self.scheduler.pick(self.now_s)
        if slot is None:
            due_s = self.scheduler.next_due_s()
            assert due_s < inf or until_s < inf
            self.now_s = max(min(due_s, until_s), self.now_s)
            return None
        self.slots.append((self.now_s, slot))
        began_s = self.now_s
        self.now_s += self._took_s(slot)
        outcome = self._outcome_of(slot, self.now_s)
        self.scheduler.record(slot, outcome, self.now_s)
        if not isinstance(outcome, Silent):
            self._note_answer(slot, began_s)
        return slot

    def run(self, until_s: float) -> None:
        """Serve until then."""
        while self.now_s < until_s:
            self.step(until_s)

    def _note_answer(self, slot: Slot, began_s: float) -> None:
        if slot.unit in self.served_s:
            gap_s = began_s - self.served_s[slot.unit]
            self.unserved_s[slot.unit] = max(self.unserved_s[slot.unit], gap_s)
        self.served_s[slot.unit] = began_s
        if slot.poll is None:
            return
        key = slot.poll.key
        if key in self.answered_s:
            self.gaps_s[key].append(self.now_s - self.answered_s[key])
        self.answered_s[key] = self.now_s
