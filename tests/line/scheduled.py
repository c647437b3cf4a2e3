"""A scheduler under test, and how it is asked step by step."""

from __future__ import annotations

import itertools
import random

from gateway.line.rtu.outcome import Answered, Garbled, Outcome
from gateway.line.scheduler.requests import Job, Poll, Priority, Slot
from gateway.line.scheduler.scheduler import Scheduler
from gateway.modbus.pdu import Request
from gateway.modbus.reads import ReadHoldingRegisters
from gateway.modbus.writes import WriteRegister

READ = ReadHoldingRegisters(0, 1)
WRITE = WriteRegister(1, 2)
ANSWERED = Answered((1,), at_s=0.0, response_time_s=0.005)
GARBLED = Garbled("bad CRC", b"\x01")


def job(lane: Priority = Priority.COMMAND, unit: int = 1, request: Request = WRITE) -> Job:
    return Job(unit, request, 0.01, lane, lambda outcome: None)


def take(scheduler: Scheduler, now_s: float, outcome: Outcome = ANSWERED) -> Slot | None:
    slot = scheduler.pick(now_s)
    if slot is not None:
        scheduler.record(slot, outcome, now_s)
    return slot


def gaps(times_s: list[float]) -> list[float]:
    return [later - earlier for earlier, later in itertools.pairwise(times_s)]


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
