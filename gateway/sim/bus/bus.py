"""A virtual RS-485 bus: units and one master, with true byte times and silences on the running loop's clock.

It records the frames (`Frame`) and what the master did wrong (`BusViolation`): a frame that is too early,
broken by a pause or in collision with another, or a request too soon after a broadcast.
"""

from __future__ import annotations

import asyncio
import random
from bisect import bisect_right
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from operator import itemgetter

from gateway.errors import BadFrameError
from gateway.modbus import BROADCAST, Adu, LineTiming, decode, encode
from gateway.sim.bus.faults import Impairment, Impairments, Noisy, Reply
from gateway.sim.core.unit import SimulatedUnit

Sink = Callable[[bytes, float], None]  # bytes that arrive at the master, and when the last of them had
SHORTEST_TURNAROUND_S = 0.1  # after a broadcast [SERIAL 2.4.1]
MOST_VIOLATIONS = 10_000
_GARBAGE = 0xA5  # what a collision makes of a byte
_ARRIVAL = itemgetter(0)


@dataclass(frozen=True, slots=True)
class Frame:
    """Bytes that were on the line without a longer silence between them."""

    start_s: float
    end_s: float
    sender: int  # 0 = master, else the unit's address
    data: bytes
    note: str = ""

    def __str__(self) -> str:
        arrow = "<<" if self.sender else ">>"
        note = f"  ({self.note})" if self.note else ""
        return f"{self.start_s:.4f} {arrow} {self.data.hex(' ').upper()}{note}"


@dataclass(frozen=True, slots=True)
class BusViolation:
    """Something that the master must not do on a serial line."""

    at_s: float
    kind: str  # early, collision, broken, turnaround
    detail: str

    def __str__(self) -> str:
        return f"{self.at_s:.4f} {self.kind}: {self.detail}"


@dataclass(slots=True)
class IncomingFrame:
    """A frame of the master as it grows; a silence ends it."""

    timing: LineTiming
    start_s: float
    end_s: float
    data: bytearray = field(default_factory=bytearray)
    longest_gap_s: float = 0.0
    defect: str = ""  # why no unit can decode it
    ending: asyncio.TimerHandle | None = None  # once the silence after it is long enough

    def extend(self, data: bytes, *, start_s: float) -> None:
        """Add bytes that follow on."""
        self.longest_gap_s = max(self.longest_gap_s, start_s - self.end_s)
        self.data += data
        self.end_s = start_s + self.timing.wire_s(len(data))


class RequestQueue:
    """Pieces of replies on their way to the master, and the time at which each arrives."""

    def __init__(self, loop: Callable[[], asyncio.AbstractEventLoop], timing: LineTiming) -> None:
        self.sink: Sink | None = None  # the master; what it does not read is lost
        self.garbled_until_s = float("-inf")  # by a collision
        self._loop = loop
        self._timing = timing
        self._under_way: list[tuple[float, bytes]] = []
        self._wanted = 1  # bytes for which the master is woken
        self._timer: asyncio.TimerHandle | None = None

    def put(self, data: bytes, *, start_s: float, size: int) -> None:
        """Send bytes from a time on, in pieces of this size."""
        for at in range(0, len(data), size):
            piece = data[at : at + size]
            self._under_way.append((start_s + self._timing.wire_s(at + len(piece)), piece))
        self._under_way.sort(key=_ARRIVAL)  # another unit may be sending
        self._plan()

    def want(self, count: int) -> None:
        """Wake the master once so many bytes have arrived, or all that is under way."""
        self._wanted = count
        self._plan()

    def deliver(self, by_s: float | None = None) -> None:
        """Hand the master what has arrived by then: by now."""
        if not self._under_way:
            return
        until_s = self._loop().time() if by_s is None else by_s
        count = bisect_right(self._under_way, until_s, key=_ARRIVAL)
        arrived = self._under_way[:count]
        del self._under_way[:count]
        if arrived and self.sink is not None:
            garbled_s = self.garbled_until_s + self._timing.character_s
            received = b"".join(_garbled(piece) if at_s <= garbled_s else piece for at_s, piece in arrived)
            self.sink(received, arrived[-1][0])

    def _plan(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if not self._under_way:
            return
        lacking = self._wanted
        for by_s, piece in self._under_way:  # noqa: B007 - the last of them counts, else
            lacking -= len(piece)
            if lacking <= 0:
                break
        self._timer = self._loop().call_at(by_s, self._wake, by_s)

    def _wake(self, by_s: float) -> None:
        self._timer = None
        self.deliver(by_s)
        self._plan()


class Bus:
    """Several units on two wires, and one master at a time.

    A unit sees a request only after a sufficient silence; otherwise no unit answers, and the violation is
    recorded. Replies arrive in pieces of `chunk_bytes` (None: whole) at their true times.
    """

    def __init__(
        self,
        timing: LineTiming,
        units: Iterable[SimulatedUnit] = (),
        *,
        name: str = "simulated",
        seed: int = 0,
        chunk_bytes: int | None = 1,
        tolerance_s: float = 1e-6,
        frames_stored: int = 1000,
    ) -> None:
        self.timing = timing
        self.name = name
        self.chunk_bytes = chunk_bytes
        self.tolerance_s = tolerance_s  # by which a silence may be too short
        self.noise: Noisy | None = None  # on everything, both ways
        self.units: list[SimulatedUnit] = []
        self.violations: list[BusViolation] = []
        self.transcript: deque[Frame] = deque(maxlen=frames_stored)
        self.impairments = Impairments(random.Random(seed))
        self._loop: asyncio.AbstractEventLoop | None = None
        self.inbox = RequestQueue(self._running, timing)
        self._incoming: IncomingFrame | None = None
        self._busy_until_s = float("-inf")  # the last byte of anyone
        self._free_s: dict[SimulatedUnit, float] = {}  # when a unit may send: it answers in order
        self._turnaround_until_s = float("-inf")
        for unit in units:
            self.add(unit)

    # The units on the line

    def add(self, unit: SimulatedUnit) -> None:
        """Connect a unit, set to this line's speed and framing."""
        unit.join(self.timing)
        self.units.append(unit)
        self._give_time(unit)

    def remove(self, unit: SimulatedUnit) -> None:
        """Take a unit off the wires."""
        self.units.remove(unit)

    def unit(self, address: int) -> SimulatedUnit:
        """Return the first unit with this address."""
        return next(unit for unit in self.units if unit.address == address)

    def impair(
        self, address: int, impairment: Impairment, *, count: int | None = None, chance: float = 1.0
    ) -> None:
        """Impair the replies of a unit: the next `count`, or until it is healed; each with this chance."""
        self.impairments.begin(address, impairment, count=count, chance=chance)

    def heal(self, address: int) -> None:
        """End a unit's impairment."""
        self.impairments.end(address)

    def advance(self) -> None:
        """Let all units live up to now."""
        for unit in self.units:
            unit.advance(self._now_s())

    # The master's end

    def attach(self, sink: Sink) -> None:
        """Connect the master of the running loop; what it does not read is lost."""
        self._loop = asyncio.get_running_loop()
        self.inbox.sink = sink
        for unit in self.units:
            self._give_time(unit)

    def detach(self) -> None:
        """Disconnect the master."""
        self.inbox.deliver()
        self.inbox.sink = None

    def send(self, data: bytes, timing: LineTiming | None = None) -> None:
        """Put bytes of the master on the wires, behind those that it has not yet sent."""
        self.inbox.deliver()  # what a collision from now on does not garble
        timing = timing or self.timing
        start_s = max(self._now_s(), self._incoming.end_s if self._incoming else 0.0)
        frame = self._incoming
        if frame is not None and start_s - frame.end_s >= timing.silence_s - self.tolerance_s:
            self._end_frame()
            frame = None
        if frame is None:
            frame = self._incoming = IncomingFrame(timing, start_s, start_s)
            frame.defect = self._judge_start(start_s, timing)
        frame.extend(data, start_s=start_s)
        if frame.defect == "collision":
            self.inbox.garbled_until_s = frame.end_s
        self._busy_until_s = max(self._busy_until_s, frame.end_s)
        if frame.ending is not None:
            frame.ending.cancel()
        frame.ending = self._running().call_at(frame.end_s + timing.silence_s, self._end_frame)

    # How a frame of the master is taken

    def _judge_start(self, start_s: float, timing: LineTiming) -> str:
        """Return why a frame that begins now is lost, and put it on record; "" when it is not."""
        if start_s < self._turnaround_until_s - self.tolerance_s:
            self._violate(start_s, "turnaround", "too soon after a broadcast")
        gap_s = start_s - self._busy_until_s
        if gap_s < -self.tolerance_s:
            self._violate(start_s, "collision", "a unit was still sending")
            return "collision"
        if gap_s < timing.silence_s - self.tolerance_s:
            self._violate(
                start_s, "early", f"{gap_s * 1000:.3f} ms of {timing.silence_s * 1000:.3f} ms silence"
            )
            return "early"
        return ""

    def _end_frame(self) -> None:
        """Take the master's frame as whole: the silence after it is long enough."""
        frame, self._incoming = self._incoming, None
        if frame is None:
            return
        if frame.ending is not None:
            frame.ending.cancel()
        data = self.noise.flip(bytes(frame.data), self.impairments.dice) if self.noise else bytes(frame.data)
        self.transcript.append(Frame(frame.start_s, frame.end_s, 0, data, frame.defect))
        adu = None if frame.defect else self._decode(frame, data)
        if adu is None:
            for unit in self.units:
                unit.note_reception_error(is_crc=True, byte_count=len(data))
            return
        if adu.unit == BROADCAST:
            self._turnaround_until_s = frame.end_s + SHORTEST_TURNAROUND_S
        for unit in list(self.units):
            if adu.unit in (BROADCAST, unit.address) and self._understands(unit, frame):
                self._ask(unit, adu, frame)

    def _decode(self, frame: IncomingFrame, data: bytes) -> Adu | None:
        try:
            return decode(data)
        except BadFrameError as error:
            if self.noise is None:
                self._violate(frame.start_s, "broken", str(error))
            return None

    def _understands(self, unit: SimulatedUnit, frame: IncomingFrame) -> bool:
        characters_s = unit.longest_gap_characters / 3.5 * frame.timing.silence_s
        is_whole = frame.longest_gap_s <= characters_s + self.tolerance_s
        return is_whole and unit.listens_to(frame.timing)

    def _ask(self, unit: SimulatedUnit, adu: Adu, frame: IncomingFrame) -> None:
        pdu = unit.handle(adu.pdu, self._now_s())
        if pdu is None or adu.unit == BROADCAST:
            return
        reply = Reply(
            adu=encode(adu.unit, pdu),
            after_s=unit.response_delay_s(adu.pdu),
            deadline_s=unit.longest_response_s(adu.pdu),
        )
        for each in self.impairments.apply(adu.unit, reply):
            start_s = max(frame.end_s + each.after_s, self._free_s.get(unit, 0.0), self._now_s())
            self._free_s[unit] = start_s + self.timing.wire_s(len(each.adu)) + self.timing.silence_s
            self._running().call_at(start_s, self._transmit, adu.unit, each.adu)

    # The replies of units

    def _transmit(self, address: int, data: bytes) -> None:
        """Let a unit send from now on; whatever else is sent meanwhile becomes garbage, as does this."""
        self.inbox.deliver()
        start_s = self._now_s()
        end_s = start_s + self.timing.wire_s(len(data))
        frame = self._incoming
        if frame is not None:  # the master's bytes, or the silence that should have followed them
            self._violate(frame.start_s, "collision", f"unit {address} had not yet answered")
            frame.defect = "collision"
            self.inbox.garbled_until_s = max(self.inbox.garbled_until_s, frame.end_s)
        elif start_s < self._busy_until_s - self.tolerance_s:  # another unit is sending
            overlap_s = min(self._busy_until_s, end_s)
            self.inbox.garbled_until_s = max(self.inbox.garbled_until_s, overlap_s)
        self._busy_until_s = max(self._busy_until_s, end_s)
        sent = self.noise.flip(data, self.impairments.dice) if self.noise else data
        self.transcript.append(Frame(start_s, end_s, address, sent))
        self.inbox.put(sent, start_s=start_s, size=self.chunk_bytes or len(sent))

    def _violate(self, at_s: float, kind: str, detail: str) -> None:
        if len(self.violations) >= MOST_VIOLATIONS:  # a master that never learns
            del self.violations[0]
        self.violations.append(BusViolation(at_s, kind, detail))

    def _give_time(self, unit: SimulatedUnit) -> None:
        if self._loop is not None:
            unit.clock = self._loop.time
            unit.advance(self._loop.time())

    def _running(self) -> asyncio.AbstractEventLoop:
        return self._loop if self._loop is not None else asyncio.get_running_loop()

    def _now_s(self) -> float:
        return self._running().time()


def _garbled(piece: bytes) -> bytes:
    return bytes(byte ^ _GARBAGE for byte in piece)
