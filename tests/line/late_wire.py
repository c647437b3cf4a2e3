"""A line whose starters answer late, twice or in the wrong order: an own clock, no event loop, very fast.

Every reply carries the number of the request it answers, so that one taken for another's cannot hide. Late
bytes arrive whole and clean, whatever else is under way: a true line would spoil most of them.
"""

from __future__ import annotations

import heapq
import random
from collections import Counter
from collections.abc import Coroutine
from dataclasses import dataclass
from math import inf
from typing import Any, TypeVar

from gateway.line.rtu.late_replies import KEPT_ENOUGH
from gateway.line.rtu.outcome import Answered
from gateway.line.rtu.trace import Trace
from gateway.line.rtu.transaction import LATE_FACTOR, RtuMaster
from gateway.modbus import adu
from gateway.modbus.pdu import Request
from gateway.modbus.reads import ReadHoldingRegisters, ReadInputRegisters
from gateway.modbus.server import decode_request
from gateway.modbus.timing import Framing, LineTiming

T = TypeVar("T")

ALLOWANCE_S = 0.02
DELAYS_S = (0.002, 0.009)  # of a reply in time
EARLIEST = 0.9  # of a late reply's beginning, in deadlines


class LateWire:
    """A Port and the starters behind it."""

    def __init__(
        self, timing: LineTiming, chance: random.Random, *, late_share: float, limit_s: float
    ) -> None:
        self.now_s = 0.0
        self.last_byte_s = -inf
        self.counts: Counter[str] = Counter()
        self.asked = 0  # requests so far: the number in the next reply
        self._timing = timing
        self._chance = chance
        self._late_share = late_share
        self._limit_s = limit_s
        self._own_end_s = -inf
        self._arrivals: list[tuple[float, int, bytes]] = []
        self._serial = 0
        self._held: list[tuple[bytes, float]] = []  # swapped replies, and until when they can be late

    def time(self) -> float:
        return self.now_s

    def write(self, frame: bytes) -> None:
        silence_s = self.now_s - max(self._own_end_s, self.last_byte_s)
        assert silence_s > self._timing.silence_s - 1e-9, f"sent after {silence_s} s of silence"
        self.asked += 1
        self._own_end_s = end_s = self.now_s + self._timing.wire_s(len(frame))
        unit, pdu = adu.decode(frame)
        request = decode_request(pdu)
        words = (unit, self.asked >> 16, self.asked & 0xFFFF, *([0] * 200))[: request.count]
        reply = adu.encode(unit, request.encode_reply(words))
        reply_s = self._timing.wire_s(len(reply))
        self._answer(reply, end_s, reply_s, end_s + self._limit_s + reply_s + ALLOWANCE_S)

    async def read(self, *, until_s: float, count: int = 1) -> bytes:
        heard = b""
        while self._arrivals and self._arrivals[0][0] <= max(until_s, self.now_s):
            at_s, _, chunk = heapq.heappop(self._arrivals)
            self.now_s = max(self.now_s, at_s)
            self.last_byte_s = at_s
            heard += chunk
            if len(heard) >= count:
                return heard
        self.now_s = max(self.now_s, until_s)
        return heard

    def close(self) -> None: ...

    def _answer(self, reply: bytes, end_s: float, reply_s: float, deadline_s: float) -> None:
        chance = self._chance
        start_s = end_s + chance.uniform(*DELAYS_S)
        late_s = end_s + chance.uniform(EARLIEST, LATE_FACTOR) * (deadline_s - end_s)
        held, self._held = self._held, []
        kind = "in time"
        if self.asked > KEPT_ENOUGH and chance.random() < self._late_share:
            kind = chance.choice(("late", "late", "doubled", "late and doubled", "swapped"))
        self.counts[kind] += 1
        if kind == "swapped":
            self._held = [(reply, end_s + LATE_FACTOR * (deadline_s - end_s))]
        else:
            self._say(reply, late_s if kind.startswith("late") else start_s)
        if kind == "doubled":
            self._say(reply, start_s + reply_s + chance.uniform(0.0, self._timing.silence_s))
        if kind == "late and doubled":
            self._say(reply, late_s + reply_s + chance.uniform(0.0, self._timing.silence_s))
        for earlier, until_s in held:
            beside_s = start_s + chance.choice((-reply_s, reply_s))
            if self.now_s <= min(beside_s, until_s):  # else it would be later than late
                self._say(earlier, min(beside_s, until_s))

    def _say(self, reply: bytes, start_s: float) -> None:
        size = len(reply) if self._chance.random() < 0.7 else self._chance.randint(1, len(reply))
        start_s = max(start_s, self.now_s)
        for at in range(0, len(reply), size):
            chunk = reply[at : at + size]
            start_s += self._timing.wire_s(len(chunk))
            self._serial += 1
            heapq.heappush(self._arrivals, (start_s, self._serial, chunk))


@dataclass(frozen=True)
class Tally:
    """What became of all requests."""

    counts: Counter[str]  # by the kind of reply
    answered: int
    wrong: int  # answers that were another request's
    asked: int


def ask_for_long(transactions: int, *, seed: int, baud: int = 19200) -> Tally:
    """Ask the starters of lines that are late to different degrees."""
    chance = random.Random(seed)
    counts: Counter[str] = Counter()
    answered = wrong = asked = 0
    while asked < transactions:
        share = chance.uniform(0.02, 0.10)
        limit_s = chance.choice((0.010, 0.020, 0.100))
        wire = LateWire(LineTiming(baud, Framing.parse("8E1")), chance, late_share=share, limit_s=limit_s)
        line = RtuMaster(wire, wire._timing, allowance_s=ALLOWANCE_S, trace=Trace("late"), time=wire.time)
        requests = _requests(chance)
        for _ in range(min(5000, transactions - asked)):
            unit, request = _next(line, requests, wire.now_s)
            outcome = run(line.transact(unit, request, response_time_s=limit_s))
            if isinstance(outcome, Answered):
                answered += 1
                wrong += outcome.value[:3] != (unit, wire.asked >> 16, wire.asked & 0xFFFF)
        asked += wire.asked
        counts += wire.counts
    return Tally(counts, answered, wrong, asked)


def run(work: Coroutine[Any, Any, T]) -> T:
    """Run a coroutine that never has to wait."""
    try:
        work.send(None)
    except StopIteration as done:
        return done.value  # type: ignore[no-any-return]  # what the coroutine returns
    raise AssertionError("it waits for something")


def _requests(chance: random.Random) -> list[tuple[int, Request]]:
    """Return what is asked in turn: of one to eight starters, a block or two each."""
    kinds = (ReadHoldingRegisters(0, 10), ReadHoldingRegisters(100, 10), ReadInputRegisters(0, 10))
    kinds += (ReadHoldingRegisters(0, 3),)
    units = range(1, chance.choice((1, 2, 8)) + 1)
    return [(unit, kind) for kind in chance.sample(kinds, chance.choice((1, 2))) for unit in units]


def _next(line: RtuMaster, requests: list[tuple[int, Request]], now_s: float) -> tuple[int, Request]:
    """Return the next request that may be sent at once, as the plan lets others pass; else the first."""
    for at, (unit, request) in enumerate(requests):
        if line.free_from_s(unit, request) <= now_s:
            requests.append(requests.pop(at))
            return requests[-1]
    requests.append(requests.pop(0))
    return requests[-1]
