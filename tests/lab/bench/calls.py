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
from pathlib import Path
from types import FrameType
from typing import Any

from gateway.line.port.opener import SerialOpener
from gateway.line.scheduler.requests import Poll
from gateway.line.thread import LineHost
from gateway.modbus import adu
from gateway.modbus.reads import ReadHoldingRegisters
from gateway.modbus.timing import Framing, LineTiming
from gateway.modbus.writes import WriteCoil
from tests.rig import RigPlant
from tests.rig.sites import line, starter

UNITS = 8
REGISTERS = 10
WARM, COUNTED = 60, 400  # transactions
LONGEST_S = 30.0
ROOT = Path(__file__).parents[3]
OWN = ROOT / "gateway"
LEFT_OUT = (str(OWN / "sim"), str(OWN / "plugins"), str(ROOT / "tests"))  # plugins are beside every way
SITE = line() + starter("pump", 1, "ssw07", every_s=4.87, watchdog_s=0.0)


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
def profiled(note: Callable[[FrameType, str, Any], object]) -> Iterator[None]:
    """Have each call and return on this thread noted."""
    sys.setprofile(note)
    try:
        yield
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


def publication_calls() -> Counts:
    """Return the calls from a reply with one changed value to its message: the fewest that were seen.

    The message is at its end when the session is given it. What else was due at that moment, another request
    or a look at the clock, is not on this way.
    """
    way = _Way()
    with RigPlant(SITE) as plant:
        plant.run(until=3.0)
        for coil in (101, 100):
            plant.starter("pump").unit.handle(WriteCoil(coil, is_on=True).encode(), plant.loop.time())
        plant.run(until=121.0)
        with profiled(way.note):
            plant.run(until=421.0)
    usual = [counts for messages, counts in way.found if messages == 1 and _is_usual(counts)]
    return min(usual, key=lambda counts: counts.calls)


class _Way:
    """Counts from each reply to the last message that it leads to."""

    def __init__(self) -> None:
        self.found: list[tuple[int, Counts]] = []  # messages and calls of each reply that changed something
        self._counts: Counts | None = None
        self._messages = 0

    def note(self, frame: FrameType, event: str, value: Any) -> None:
        """Begin at a reply, and count."""
        name = frame.f_code.co_qualname
        if event == "return" and name == "SimulatedPort.read" and isinstance(value, bytes) and value:
            self._counts, self._messages = Counts(), 0
        if self._counts is None:
            return
        self._counts.note(frame, event, value)
        if event == "call" and name == "Session.publish" and "/value/" in frame.f_locals["message"].topic:
            if self._messages:
                self.found.pop()
            self._messages += 1
            self.found.append((self._messages, Counts(self._counts.calls, Counter(self._counts.by_place))))


def _is_usual(counts: Counts) -> bool:
    return counts.entered("RtuMaster.send") == 0 and counts.entered("StarterTelemetry.on_poll") == 1


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
