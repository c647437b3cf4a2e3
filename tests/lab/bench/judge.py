"""The judge: lines of starters on pseudo terminals with exact times, a process of its own.

`python -m tests.lab.bench.judge SPEC` (JSON, see `Spec`) prints the terminals' paths, serves until its
standard input ends, and prints what it saw. A pseudo terminal carries bytes at once, so the judge computes:
a request starts on the wire when it arrives and takes its characters' time; the reply is due a fixed delay
later and is handed over at the time of its last byte, or byte by byte. Waits end in a busy loop, and so does
the time in which a request is expected, so that the judge's own wake-up is not charged to the master.
"""

from __future__ import annotations

import ctypes
import gc
import heapq
import json
import os
import select
import sys
import time
import tty
from dataclasses import dataclass, field
from math import inf

from gateway.modbus import adu
from gateway.modbus.codes import ExceptionCode
from gateway.modbus.pdu import encode_exception
from gateway.modbus.reads import ReadHoldingRegisters, ReadInputRegisters
from gateway.modbus.server import decode_request
from gateway.modbus.timing import Framing, LineTiming
from gateway.sim.core.unit import SimulatedUnit
from gateway.sim.factory import make_unit
from tests.lab.bench.account import SeenRequest
from tests.modbus.request_size import request_adu_size

BUSY_S = 0.0002  # before something is due, sleeping is over
BEFORE_S = 0.0001  # so long before a silence is over, and so long after it, no sleep hides a request
WATCHED_S = 0.0015
WATCHED_SHARED_S = 0.0004  # where several lines share the judge
IDLE_S = 0.2
_PR_SET_TIMERSLACK = 29


@dataclass(frozen=True)
class Spec:
    """What a judge serves."""

    baud: int = 19200
    framing: str = "8N2"
    lines: int = 1
    units: int = 8  # on each line, at 1, 2, ..
    dead: tuple[int, ...] = ()
    family: str = ""  # simulated starters of this family; "": ten registers or what else is asked for
    is_bytewise: bool = False
    is_standing: bool = False  # no motor runs: nothing ever changes
    is_calm: bool = False  # sleeps instead of waiting in a busy loop, which slows down what shares its core
    delay_s: float = 0.005

    @property
    def timing(self) -> LineTiming:
        return LineTiming(self.baud, Framing.parse(self.framing))


@dataclass
class _Tap:
    """One line: its pseudo terminal and what is on the wire."""

    number: int
    ours: int
    theirs: int  # held open: without any opener our end could not be read
    units: dict[int, SimulatedUnit]
    received: bytearray = field(default_factory=bytearray)
    began_s: float = -inf  # first byte of the request under way
    quiet_s: float = -inf  # last byte of whatever was on the wire
    is_replying: bool = False


class Judge:
    """Serves all lines in one loop."""

    def __init__(self, spec: Spec) -> None:
        self._spec = spec
        self._timing = spec.timing
        self._taps = {tap.ours: tap for tap in (self._open(number) for number in range(spec.lines))}
        self._due: list[tuple[float, int, _Tap, bytes, SeenRequest | None]] = []
        self._serial = 0
        self._poller = select.poll()
        for fd in (*self._taps, sys.stdin.fileno()):
            self._poller.register(fd, select.POLLIN)
        self.seen: list[SeenRequest] = []

    @property
    def paths(self) -> list[str]:
        """The terminals that masters open."""
        return [os.ttyname(tap.theirs) for tap in self._taps.values()]

    def serve(self) -> None:
        """Serve until the standard input ends."""
        clock, due, ready_now = time.monotonic, self._due, self._poller.poll
        while True:
            while due and due[0][0] <= clock():
                self._hand_over(heapq.heappop(due))
            now_s = clock()
            sleep_s = self._sleep_s(now_s)
            if sleep_s > 0:
                select.select([*self._taps, sys.stdin.fileno()], [], [], sleep_s)
            else:
                os.sched_yield()
            for fd, _ in ready_now(0):
                if fd not in self._taps:
                    return
                self._take(self._taps[fd], os.read(fd, 512), clock())

    def _open(self, number: int) -> _Tap:
        ours, theirs = os.openpty()
        tty.setraw(theirs)
        spec = self._spec
        units: dict[int, SimulatedUnit] = {}
        if spec.family:
            units = {n: make_unit(spec.family, n, seed=n) for n in range(1, spec.units + 1)}
            for unit in () if spec.is_standing else units.values():
                unit.motor.start()  # a running motor's current is never the same twice
        return _Tap(number, ours, theirs, units)

    def _sleep_s(self, now_s: float) -> float:
        """Return how long nothing can happen that must be met on the spot."""
        wake_s = now_s + IDLE_S
        if self._due:
            wake_s = min(wake_s, self._due[0][0] - (0.0 if self._spec.is_calm else BUSY_S))
        if self._spec.is_calm:
            return wake_s - now_s
        for tap in self._taps.values():
            if tap.is_replying:
                continue
            free_s = tap.quiet_s + self._timing.silence_s
            watched_s = WATCHED_S if len(self._taps) == 1 else WATCHED_SHARED_S
            if now_s < free_s + watched_s:
                wake_s = min(wake_s, free_s - BEFORE_S)
        return wake_s - now_s

    def _take(self, tap: _Tap, chunk: bytes, now_s: float) -> None:
        if not tap.received:
            tap.began_s = now_s
        tap.received += chunk
        size = request_adu_size(bytes(tap.received))
        if size is None or len(tap.received) < size:
            return
        request = bytes(tap.received[:size])
        tap.received.clear()
        gap_s = tap.began_s - tap.quiet_s
        tap.quiet_s = max(tap.began_s, tap.quiet_s) + self._timing.wire_s(size)
        unit, pdu = adu.decode(request)
        seen = SeenRequest(tap.number, tap.began_s, unit, pdu[0], size, 0, tap.quiet_s, gap_s, 0.0)
        reply = self._reply(tap, unit, pdu, now_s)
        if not reply:
            self.seen.append(seen)
            return
        tap.is_replying = True
        self._plan(tap, reply, seen._replace(reply_size=len(reply)))

    def _plan(self, tap: _Tap, reply: bytes, seen: SeenRequest) -> None:
        first_s = tap.quiet_s + self._spec.delay_s
        step = 1 if self._spec.is_bytewise else len(reply)
        for end in range(step, len(reply) + 1, step):
            self._serial += 1
            due_s = first_s + self._timing.wire_s(end)
            of_last = seen if end == len(reply) else None
            heapq.heappush(self._due, (due_s, self._serial, tap, reply[end - step : end], of_last))

    def _hand_over(self, due: tuple[float, int, _Tap, bytes, SeenRequest | None]) -> None:
        due_s, _, tap, chunk, seen = due
        now_s = time.monotonic()
        os.write(tap.ours, chunk)
        tap.quiet_s = max(tap.quiet_s, now_s)
        if seen is not None:
            tap.is_replying = False
            self.seen.append(seen._replace(end_s=now_s, late_s=now_s - due_s))

    def _reply(self, tap: _Tap, unit: int, pdu: bytes, now_s: float) -> bytes:
        """Return the reply's ADU; b"" of a dead unit, one that is not there, and to a broadcast."""
        if unit in self._spec.dead or not 1 <= unit <= self._spec.units:
            return b""
        starter = tap.units.get(unit)
        answer = _plain_answer(pdu) if starter is None else starter.handle(pdu, now_s)
        return b"" if answer is None else adu.encode(unit, answer)


def _plain_answer(pdu: bytes) -> bytes:
    """Return a right answer to a read of words, and to the writes that are mirrored."""
    if pdu[0] in (5, 6):
        return pdu
    request = decode_request(pdu)
    if not isinstance(request, ReadHoldingRegisters | ReadInputRegisters):
        return encode_exception(pdu[0], ExceptionCode.ILLEGAL_FUNCTION)
    return request.encode_reply(tuple(range(request.count)))


def main() -> None:
    """Serve what the command line says."""
    given = json.loads(sys.argv[1])
    judge = Judge(Spec(**{**given, "dead": tuple(given.get("dead", ()))}))
    ctypes.CDLL(None).prctl(_PR_SET_TIMERSLACK, 1, 0, 0, 0)
    print(json.dumps(judge.paths), flush=True)
    gc.disable()
    judge.serve()
    print(json.dumps(judge.seen), flush=True)


if __name__ == "__main__":
    main()
