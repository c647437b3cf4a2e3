"""The masters under test that are Python programs: `python -m tests.lab.bench.subjects KIND TASK`.

Each polls ten registers of every unit, over and over, for `warm_s` and then `seconds`, and prints when the
measured time began and ended, on the clock that all processes share, and what processor time it took.
"""

from __future__ import annotations

import asyncio
import gc
import json
import logging
import os
import random
import resource
import select
import sys
import time
import tty
from dataclasses import asdict, dataclass, field

from tests.lab.bench.account import Submitted

REGISTERS = 10


@dataclass(frozen=True)
class Task:
    """What a master is to do."""

    ports: tuple[str, ...]
    baud: int
    framing: str
    units: int
    warm_s: float
    seconds: float
    response_s: float = 0.005  # as our line is configured
    stops: int = 0  # at random moments of the measured time


@dataclass
class Span:
    """What a master reports."""

    from_s: float
    to_s: float
    cpu_s: float
    rss_kib: int
    stops: list[Submitted] = field(default_factory=list)
    marks: list[tuple[float, float]] = field(default_factory=list)  # of the pinger: (written, read)


class _Clock:
    """The measured time and what it cost."""

    def __init__(self, task: Task) -> None:
        self.from_s = time.monotonic() + task.warm_s
        self.to_s = self.from_s + task.seconds
        self._cpu_s = 0.0

    def note_begin(self) -> None:
        self.from_s, self._cpu_s = time.monotonic(), _cpu_s()

    def span(self) -> Span:
        return Span(self.from_s, time.monotonic(), _cpu_s() - self._cpu_s, _rss_kib())


async def line(task: Task) -> Span:
    """Our line layer as the gateway runs it: a thread of its own, outcomes carried over to the app's loop."""
    from gateway.line.port.opener import SerialOpener
    from gateway.line.scheduler.requests import Poll, Priority
    from gateway.line.thread import LineHost
    from gateway.modbus.reads import ReadHoldingRegisters
    from gateway.modbus.timing import Framing, LineTiming
    from gateway.modbus.writes import WriteCoil

    timing = LineTiming(task.baud, Framing.parse(task.framing))
    host = LineHost(lambda _: None)
    request = ReadHoldingRegisters(0, REGISTERS)
    clients = [
        host.add_line(
            name=f"line-{number}",
            opener=SerialOpener(port, task.baud, timing.framing),
            timing=timing,
            polls=[
                Poll(f"u{unit}", unit, request, 0.0, task.response_s) for unit in range(1, task.units + 1)
            ],
        )
        for number, port in enumerate(task.ports)
    ]
    await host.start()
    await asyncio.sleep(task.warm_s)
    clock = _Clock(task)
    clock.note_begin()
    end_s = clock.from_s + task.seconds
    stops: list[Submitted] = []
    chance = random.Random(1)
    for _ in range(task.stops):
        await asyncio.sleep(chance.uniform(0.5, 1.5) * task.seconds / task.stops * 0.9)
        unit = chance.randint(1, task.units)
        now_s = time.monotonic()
        stops.append(Submitted(now_s, now_s, unit))
        await clients[0].transact(
            unit, WriteCoil(100, False), response_time_s=task.response_s, lane=Priority.STOP
        )
    await asyncio.sleep(max(end_s - time.monotonic(), 0.0))
    span = clock.span()
    span.stops = stops
    await host.stop()
    return span


def pinger(task: Task) -> Span:
    """A master that does nothing but note when it writes and when it can read, without ever sleeping."""
    from gateway.modbus import adu
    from gateway.modbus.reads import ReadHoldingRegisters

    gc.disable()
    fd = os.open(task.ports[0], os.O_RDWR | os.O_NOCTTY)
    tty.setraw(fd)
    poller = select.poll()
    poller.register(fd, select.POLLIN)
    request = adu.encode(1, ReadHoldingRegisters(0, REGISTERS).encode())
    clock = _Clock(task)
    marks: list[tuple[float, float]] = []
    while time.monotonic() < clock.to_s:
        written_s = time.monotonic()
        os.write(fd, request)
        received = b""
        while len(received) < 5 + 2 * REGISTERS:
            while not poller.poll(0):
                os.sched_yield()
            read_s = time.monotonic()
            received += os.read(fd, 512)
        marks.append((written_s, read_s))
        while time.monotonic() < read_s + 0.0025:
            os.sched_yield()
    span = clock.span()
    span.marks = marks
    return span


def _cpu_s() -> float:
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def _rss_kib() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def main() -> None:
    """Do what the command line says."""
    kind, given = sys.argv[1], json.loads(sys.argv[2])
    task = Task(**{**given, "ports": tuple(given["ports"])})
    logging.disable()
    span = asyncio.run(line(task)) if kind == "line" else pinger(task)
    print(json.dumps(asdict(span)), flush=True)


if __name__ == "__main__":
    main()
