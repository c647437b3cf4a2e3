"""A line whose starters answer late, twice or in the wrong order: an own clock, no event loop, very fast.

Every reply carries the number of the latest change of what the starters say, so that one taken for another's
cannot hide; where that changes before each request, it is the number of the request. Late bytes arrive whole
and clean, whatever else is under way: a true line would corrupt most of them. A frame with another's bytes
within passes its CRC once in 65,536 times: `mixed` says when there was one.
"""

from __future__ import annotations

import heapq
import random
from collections import Counter, deque
from collections.abc import Sequence
from dataclasses import dataclass
from math import inf

from gateway.modbus import adu
from gateway.modbus.codes import ExceptionCode, Function
from gateway.modbus.pdu import Request, encode_exception
from gateway.modbus.server import decode_request
from gateway.modbus.timing import LineTiming

ALLOWANCE_S = 0.02
DELAYS_S = (0.002, 0.009)  # of a reply in time
LATE_DEADLINES = (0.5, 200.0)  # a late reply begins so many deadlines after its request
LATEST_S = 10.0
COPIED_WITHIN_S = 0.020  # of the end of a reply its copy begins
STALLS_S = (0.5, 5.0)
STALL_EVERY_S = 40.0  # on the average, on a way that stalls
STATUS = 5001  # the register whose bits are the coils 0 to 15, as on the SSW-06 and SSW-07


@dataclass(frozen=True)
class Faults:
    """What may be wrong with a line's replies, as shares of all."""

    share: float
    kinds: tuple[str, ...] = ("late", "late", "doubled", "late and doubled", "swapped")
    lost: float = 0.0  # the share of the faulty replies that never come
    stalls: bool = False  # it is reached over TCP, by a way that stands still at times
    changes: float = 1.0  # the share of requests before which all that the starters say changes


class LateWire:
    """A Port and the starters behind it."""

    def __init__(self, timing: LineTiming, chance: random.Random, faults: Faults, *, limit_s: float) -> None:
        self.now_s = 0.0
        self.last_byte_s = -inf
        self.counts: Counter[str] = Counter()
        self.asked = 0  # requests so far
        self.changed = 0  # the number in the next reply: of the request before which it changed last
        self.refused: set[tuple[int, int]] = set()  # unit and address
        self._timing = timing
        self._chance = chance
        self._faults = faults
        self._limit_s = limit_s
        self._own_end_s = -inf
        self._arrivals: list[tuple[float, int, bytes, int, int]] = []  # with bytes of the frame still to come
        self.mixed = 0  # the number of the latest request while which frames came within others
        self._rest = 0  # bytes of the frame under way still to come
        self.answered = 0  # the number of the request that the latest bytes answer: a write's do not show it
        self.whole: deque[int] = deque(maxlen=1000)  # the numbers of the requests answered last
        self._serial = 0
        self._held: tuple[bytes, int] | None = None  # the reply that is swapped with the next, its number
        self._held_s = -inf
        self._stall_s, self._stall_end_s = inf, -inf
        if faults.stalls:
            self._stall_s = chance.expovariate(1 / STALL_EVERY_S)

    def time(self) -> float:
        return self.now_s

    def write(self, frame: bytes) -> None:
        silence_s = self.now_s - max(self._own_end_s, self.last_byte_s)
        assert silence_s > self._timing.silence_s - 1e-9, f"sent after {silence_s} s of silence"
        self.asked += 1
        if self._faults.changes == 1.0 or self._chance.random() < self._faults.changes:
            self.changed = self.asked
        self._own_end_s = end_s = self.now_s + self._timing.wire_s(len(frame))
        unit, pdu = adu.decode(frame)
        request = decode_request(pdu)
        reply = adu.encode(unit, self._reply(unit, request))
        reply_s = self._timing.wire_s(len(reply))
        self._answer(reply, end_s, reply_s, self._limit_s + reply_s + ALLOWANCE_S)

    async def read(self, *, until_s: float, count: int = 1) -> bytes:
        received = b""
        while self._arrivals and self._arrivals[0][0] <= max(until_s, self.now_s):
            at_s, _, chunk, self.answered, rest = heapq.heappop(self._arrivals)
            if self._rest not in (0, rest + len(chunk)):
                self.mixed = self.asked
            self._rest = rest
            if not rest:
                self.whole.append(self.answered)
            self.now_s = max(self.now_s, at_s)
            self.last_byte_s = at_s
            received += chunk
            if len(received) >= count:
                return received
        self.now_s = max(self.now_s, until_s)
        return received

    def close(self) -> None: ...

    def _reply(self, unit: int, request: Request) -> bytes:
        if request.is_write:
            return request.encode()  # FC06
        address, count = request.address, request.count  # type: ignore[attr-defined]  # all are runs
        if (unit, address) in self.refused:
            return encode_exception(request.function, ExceptionCode.ILLEGAL_DATA_ADDRESS)
        if request.function == Function.READ_COILS:
            return request.encode_reply(bits(unit, self.changed, address, count))  # type: ignore[attr-defined]
        return request.encode_reply(words(unit, self.changed, address, count))  # type: ignore[attr-defined]

    def _answer(self, reply: bytes, end_s: float, reply_s: float, deadline_s: float) -> None:
        chance = self._chance
        start_s = end_s + chance.uniform(*DELAYS_S)
        kind = "in time"
        if self._faults.share and chance.random() < self._faults.share:
            kind = "lost" if chance.random() < self._faults.lost else chance.choice(self._faults.kinds)
        self.counts[kind] += 1
        if kind.startswith("late"):
            start_s = end_s + min(chance.uniform(*LATE_DEADLINES) * deadline_s, LATEST_S)
        if kind == "lost":
            return
        held, self._held = self._held, None
        held_until_s = self._held_s + LATEST_S
        if kind == "swapped":
            self._held, self._held_s = (reply, self.asked), end_s
        else:
            self._say(reply, start_s, self.asked)
        if kind.endswith("doubled"):
            self._say(reply, start_s + reply_s + chance.uniform(0.0, COPIED_WITHIN_S), self.asked)
        if held is not None and start_s <= held_until_s:  # on a line that rests, it is lost
            self._say(held[0], start_s + chance.choice((-reply_s, reply_s)), held[1])

    def _say(self, reply: bytes, start_s: float, number: int) -> None:
        start_s = max(start_s, self.now_s)
        whole_s = self._timing.wire_s(len(reply))
        if self._faults.stalls:
            self._arrive(self._delivered_s(start_s + whole_s), reply, number)
            return
        size = len(reply) if self._chance.random() < 0.7 else self._chance.randint(1, len(reply))
        for at in range(0, len(reply), size):
            chunk = reply[at : at + size]
            start_s += self._timing.wire_s(len(chunk))
            self._arrive(start_s, chunk, number, rest=len(reply) - at - len(chunk))

    def _delivered_s(self, at_s: float) -> float:
        """Return when a way that stalls hands over what it was given then: all at once, in order."""
        while at_s >= self._stall_s:
            self._stall_end_s = self._stall_s + self._chance.uniform(*STALLS_S)
            self._stall_s = self._stall_end_s + self._chance.expovariate(1 / STALL_EVERY_S)
            self.counts["stalls"] += 1
        return max(at_s, self._stall_end_s)

    def _arrive(self, at_s: float, chunk: bytes, number: int, *, rest: int = 0) -> None:
        self._serial += 1
        heapq.heappush(self._arrivals, (at_s, self._serial, chunk, number, rest))


def words(unit: int, number: int, address: int, count: int) -> tuple[int, ...]:
    """Return what a unit's registers hold when the request of this number is answered."""
    base = number * 31 + unit * 4099
    return tuple((base + 257 * at) & 0xFFFF for at in range(address, address + count))


def bits(unit: int, number: int, address: int, count: int) -> Sequence[bool]:
    """Return what its coils say."""
    low, high = words(unit, number, STATUS, 2)
    status = low | high << 16
    return tuple(bool(status >> at % 32 & 1) for at in range(address, address + count))
