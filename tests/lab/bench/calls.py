"""Python calls, counted and not timed: `python -m tests.lab.bench.calls`.

On the lines' thread for each transaction, and from a reply to the message for the broker: the same on every
machine. A call is a Python function entered or resumed; what stands in the simulation or here is left out.
"""

from __future__ import annotations

import asyncio
import logging
import os
import sys
import threading
import tty
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from math import inf
from pathlib import Path
from types import FrameType
from typing import Any

from gateway.app.plant import Plant
from gateway.app.record_log import RecordLog, log_failure
from gateway.config.convert import policy_of, rights_of, timing_of
from gateway.config.reading import parse
from gateway.config.schema import LineTable
from gateway.contract import RecordBus, RecordWriter, Topics
from gateway.line.client import LineClient
from gateway.line.events import deliver
from gateway.line.port.base import Port
from gateway.line.port.opener import SerialOpener
from gateway.line.scheduler.requests import Poll
from gateway.line.thread import LineHost
from gateway.modbus import adu
from gateway.modbus.reads import ReadHoldingRegisters
from gateway.modbus.timing import Framing, LineTiming
from gateway.modbus.writes import WriteCoil
from gateway.mqtt.outbox.outbox import Outbox
from gateway.mqtt.publisher import Publisher
from gateway.sim.bus.port import SimulatedLine
from gateway.starters import Policy, RunToken, serve
from tests.lab.bench.plant import name
from tests.lab.torture.starters import watching_unit
from tests.rig.sites import line, starter, table
from tests.virtual_time import VirtualClock, run_virtually

UNITS = 8
REGISTERS = 10
WARM, COUNTED = 60, 400  # transactions
LONGEST_S = 30.0
ROOT = Path(__file__).parents[3]
OWN = ROOT / "gateway"
LEFT_OUT = (str(OWN / "sim"), str(ROOT / "tests"))
SITE = (
    table("gateway", name="bench")
    + table("mqtt", url="mqtt://127.0.0.1")
    + line()
    + starter(name(0, 1), 1, "ssw07", every_s=5.0, watchdog_s=0.0)
)


@dataclass
class Counts:
    """The Python calls of one or more threads."""

    calls: int = 0
    by_place: Counter[tuple[str, str]] = field(default_factory=Counter)

    @property
    def files(self) -> set[str]:
        """Return the gateway's files that were entered."""
        return {file for file, _ in self.by_place if file.startswith(str(OWN))}

    def entered(self, function: str) -> int:
        """Return how often a function was entered."""
        return sum(calls for (_, name), calls in self.by_place.items() if name == function)

    def note(self, frame: FrameType, event: str, _: object) -> None:
        """Count an event of `sys.setprofile`; the busy wait at the end of a silence is not work."""
        if event != "call":
            return
        code = frame.f_code
        if code.co_filename.startswith(LEFT_OUT):
            return
        back = frame.f_back
        if code.co_name == "time" and back is not None and back.f_code.co_name == "hold":
            return
        self.calls += 1
        self.by_place[code.co_filename, code.co_qualname] += 1


@contextmanager
def counted() -> Iterator[Counts]:
    """Count the calls inside, on this thread."""
    counts = Counts()
    sys.setprofile(counts.note)
    try:
        yield counts
    finally:
        sys.setprofile(None)


def line_calls() -> tuple[float, Counts]:
    """Return the calls on the lines' thread for each transaction: 8 starters, one line, one chunk a reply."""
    with answering_units() as port:
        return asyncio.run(_line_calls(port))


async def _line_calls(port: str) -> tuple[float, Counts]:
    timing = LineTiming(19200, Framing.parse("8N2"))
    host = LineHost(lambda _: None)
    line = host.add_line(
        name="line",
        opener=SerialOpener(port, timing.baud, timing.framing),
        timing=timing,
        polls=[
            Poll(f"u{unit}", unit, ReadHoldingRegisters(0, REGISTERS), 0.0, 0.005)
            for unit in range(1, UNITS + 1)
        ],
        allowance_s=1.0,  # on a busy machine an answer may be late, which costs no call
    )
    counts, begun, ended = Counts(), [0], [0]
    await host.start()

    async def until(transactions: int) -> int:
        async with asyncio.timeout(LONGEST_S):
            while (done := host.progress()["line"]) < transactions:  # noqa: ASYNC110 - it sets no event
                await asyncio.sleep(0.01)
        return done

    def switch(profile: Callable[..., Any] | None, at: list[int]) -> None:
        sys.setprofile(profile)
        at[0] = host.progress()["line"]

    await until(WARM)
    host.to_line(lambda: switch(counts.note, begun))
    await until(WARM + COUNTED)
    host.to_line(lambda: switch(None, ended))
    await until(WARM + COUNTED + 5)
    assert line.statistics()["silent"] == 0
    await host.stop()
    return counts.calls / (ended[0] - begun[0]), counts


@contextmanager
def answering_units() -> Iterator[str]:
    """Serve a pseudo terminal whose units answer each request at once, in one chunk."""
    ours, theirs = os.openpty()
    tty.setraw(ours)
    tty.setraw(theirs)
    reply = bytes((3, 2 * REGISTERS, *range(2 * REGISTERS)))

    def serve() -> None:
        while request := os.read(ours, 256):
            if request[0] == 0:
                return
            os.write(ours, adu.encode(request[0], reply))

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    try:
        yield os.ttyname(theirs)
    finally:
        os.write(theirs, bytes(8))
        thread.join(5.0)
        os.close(ours)
        os.close(theirs)


class _Way:
    """Counts from each reply to the last message that it leads to."""

    def __init__(self) -> None:
        self.found: list[tuple[int, Counts]] = []  # messages and calls of each reply that changed something
        self._counts: Counts | None = None
        self._best: tuple[int, Counts] | None = None
        self._messages = 0

    def begin(self) -> None:
        """Note that a reply is here."""
        sys.setprofile(None)
        if self._best is not None:
            self.found.append(self._best)
        self._best, self._messages = None, 0
        self._counts = Counts()
        sys.setprofile(self._counts.note)

    def note_message(self) -> None:
        """Note that the broker is given a message."""
        if self._counts is not None:
            self._messages += 1
            self._best = (self._messages, Counts(self._counts.calls, Counter(self._counts.by_place)))


async def _way() -> _Way:
    way = _Way()
    config = parse(SITE, "site.toml")
    loop = asyncio.get_running_loop()
    clock = VirtualClock(loop)
    outbox = Outbox(last_topic="", boot="boot")
    bus_of_records = RecordBus(log_failure)
    topics = Topics("starters/bench")
    publisher = Publisher(topics, RunToken("0" * 16), outbox, sink=bus_of_records, clock=clock)
    outbox.connected(1000)

    def send() -> None:
        while (outgoing := outbox.take()) is not None:
            if "/value/" in outgoing.message.topic:
                way.note_message()
            outbox.acked(outgoing.ticket, 0)

    publisher.wake = lambda: loop.call_soon(send)
    records = RecordWriter(bus_of_records, clock)
    policy = Policy(policy_of(config), [name(0, 1)], rights=rights_of(config), records=records)
    bus_of_records.connect(policy, RecordLog(clock), publisher)
    bus = SimulatedLine(timing_of(config.lines[0]))
    unit = watching_unit("ssw07", 1, 0)
    bus.add(unit)
    plant = Plant(
        publish_event=lambda *_, **__: None,
        policy=policy,
        serve=partial(serve, monitor_every_s=inf),
        records=records,
        on_readings=lambda *_: None,
        make_opener=lambda table: _Opener(bus, table, way),
    )
    host = _Host(plant.handle, has_thread=False)
    host._events._polls_wait_s = 0.0
    plant.build(host, config.lines, _Deaf())  # type: ignore[arg-type]  # all that is asked of it
    await host.start()
    await plant.start()
    for coil in (101, 100):
        unit.handle(WriteCoil(coil, is_on=True).encode(), loop.time())
    await asyncio.sleep(121.0)
    for each in host._lines.values():  # each poll is due at another time, so that none follows another
        for key in tuple(each.line.polls._polls):
            each.line.change(lambda scheduler, now_s, key=key: scheduler.polls.expedite(key, now_s))
            await asyncio.sleep(0.7)
    await asyncio.sleep(9.0)
    way.found.clear()
    await asyncio.sleep(600.0)
    sys.setprofile(None)
    await host.stop()
    await plant.close()
    return way


class _Host(LineHost):
    """Lines on this loop, left to no chance; each event is handed over by itself, and that is not counted."""

    def add_line(self, **options: Any) -> LineClient:
        return super().add_line(**options | {"seed": 0})

    def _hand_over(self, batch: Any) -> None:
        asyncio.get_running_loop().call_soon(deliver, batch, self._handle)


class _Opener:
    """Opens the simulated line; each reply that is read begins a way."""

    def __init__(self, bus: SimulatedLine, table: LineTable, way: _Way) -> None:
        self._opener = bus.opener(timing=timing_of(table))
        self._way = way
        self.name = self._opener.name

    async def __call__(self) -> Port:
        port = await self._opener()
        read = port.read

        async def noted(*, until_s: float, count: int = 1) -> bytes:
            received = await read(until_s=until_s, count=count)
            if received:
                self._way.begin()
            return received

        port.read = noted  # type: ignore[method-assign]  # that is the point of it
        return port


class _Deaf:
    """The health that a plant reports to: has nothing to do."""

    def note_change(self) -> None: ...
    def note_starter(self, *_: Any) -> None: ...
    def note_port(self, *_: Any) -> None: ...


def publication_calls() -> Counts:
    """Return the calls from a reply with one changed value to its message, in the usual case (median).

    Where another request was due, the line has sent that first: those calls are not on this way.
    """

    def is_usual(messages: int, counts: Counts) -> bool:
        is_last = counts.entered("RtuMaster.send") == 0
        return is_last and messages == 1 and counts.entered("StarterTelemetry.on_poll") == 1

    found = sorted(
        (counts for messages, counts in run_virtually(_way()).found if is_usual(messages, counts)), key=_calls
    )
    return found[len(found) // 2]


def _calls(counts: Counts) -> int:
    return counts.calls


def _print(counts: Counts, share: int, most: int) -> None:
    for (file, function), calls in counts.by_place.most_common(most):
        short = file.removeprefix(f"{ROOT}/").rpartition("/lib/")[2]
        print(f"    {calls / share:7.2f} {short}:{function}")


def main() -> None:
    """Count both and print them; `--all`: by function too."""
    logging.disable()
    most = 200 if "--all" in sys.argv else 0
    calls, counts = line_calls()
    print(f"lines' thread: {calls:.1f} calls for each transaction")
    _print(counts, COUNTED, most)
    way = publication_calls()
    print(f"from a reply to the message with its value: {way.calls} calls in {len(way.files)} files")
    _print(way, 1, most)


if __name__ == "__main__":
    main()
