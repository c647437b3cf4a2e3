"""Simulated starters in a process of their own: `python -m tests.lab.torture.starters CONFIG WATCHDOG_S`.

Orders come as lines of JSON on stdin; each gets one line of JSON on stdout (`StartersProcess`). Every starter
watches its line (P314, C8.2.5.3, R41) and records when it would have tripped; `report` says what it did.
"""

from __future__ import annotations

import asyncio
import json
import os
import random
import sys
import tty
from collections import deque
from dataclasses import replace
from itertools import pairwise, takewhile
from pathlib import Path
from typing import Any

from gateway.config.convert import timing_of
from gateway.config.reading import load
from gateway.config.schema import LineTable
from gateway.sim.bus.bus import Bus
from gateway.sim.bus.pty import PtyLine
from gateway.sim.core.unit import SimulatedUnit
from gateway.sim.factory import make_unit
from gateway.sim.sst import registers as sst_registers
from gateway.sim.ssw900.faults import C8_TIMEOUT, C8_TIMEOUT_ACTION, C8_TIMEOUT_MODE
from gateway.sim.weg.command_sources import ACTION_NONE, P_ACTION, P_TIMEOUT
from tests.lab.torture.truth import Truth

TOLERANCE_S = 0.0005  # two busy processes never wake on the spot
SILENCE_TRIPS = ("E28", "A128", "F128", "R41", "R42")
ALARM_ONLY = 2  # C8.2.5.1
INDICATE = 0  # C8.2.5.2: by default it would go to local
LATE_TICK_S = 0.005
LATE_S = 0.004  # more than this and the silences on our line are not what they seem
LATE_AROUND_S = 0.3
GAPS = 20  # of each starter that are reported, the longest
QUICK = {"ramp_up_s": 0.6, "ramp_down_s": 0.4, "coast_s": 0.4}  # of the motors


class TortureLine(PtyLine):
    """A pty that can go deaf, be flooded, and come back under another number."""

    is_deaf = False
    is_flooded = False
    _flood: asyncio.Task[None] | None = None

    def go_deaf(self) -> None:
        """Receive nothing until the process that has the port open closes it: a driver's reset helps."""
        self.is_deaf = True
        os.close(self._theirs)

    def flood(self, seconds: float, octets: bytes) -> None:
        """Fill the line with these bytes (random ones when empty), as fast as it carries them."""
        self._flood = asyncio.create_task(self._pour(seconds, octets))

    async def _pour(self, seconds: float, octets: bytes) -> None:
        loop = asyncio.get_running_loop()
        dice = random.Random(0)
        end_s = loop.time() + seconds
        self.is_flooded = True
        character_s = self.line.timing.character_s
        sent_s = loop.time()
        while loop.time() < end_s:
            await asyncio.sleep(0.005)
            count = int((loop.time() - sent_s) / character_s)
            sent_s += count * character_s
            super()._write(octets * count if octets else dice.randbytes(count), 0.0)
        self.is_flooded = False

    def _write(self, chunk: bytes, arrival_s: float) -> None:
        """Hand a reply to the master, unless others send at the same time: then nothing is left of it."""
        if not self.is_flooded:
            super()._write(chunk, arrival_s)

    def _read(self) -> None:
        try:
            data = os.read(self._ours, 4096)
        except BlockingIOError:
            return
        except OSError:  # the other side has closed a deaf port
            self._theirs = os.open(self.path, os.O_RDWR | os.O_NOCTTY)
            tty.setraw(self._theirs)
            self.is_deaf = False
            return
        if not self.is_deaf and not self.is_flooded:
            self.line.send(data)

    async def stop(self) -> None:
        """Close the pty; a deaf one has but one end left."""
        if self._flood is not None:
            self._flood.cancel()
        if self._ours >= 0 and self.is_deaf:
            self._theirs = os.open(os.devnull, os.O_RDONLY)
            self.is_deaf = False
        await super().stop()


class StarterLine:
    """One line of starters and what they have lived through."""

    def __init__(self, table: LineTable, watchdog_s: int) -> None:
        self._table = table
        self.units: dict[str, Any] = {}
        self.truths: dict[str, Truth] = {}
        for each in table.starters:
            unit = self.units[each.name] = watching_unit(each.family, each.address, watchdog_s)
            unit.motor.data = replace(unit.motor.data, **QUICK)
            self.truths[each.name] = Truth(unit, each.name)
        units = self.units.values()
        self.bus = Bus(timing_of(table), units, name=table.name, chunk_bytes=None, tolerance_s=TOLERANCE_S)
        self._marked_s = 0.0
        self._late_s: deque[float] = deque(maxlen=10_000)  # when this process itself was late
        self._line: TortureLine
        self._spare: list[tuple[int, int]] = []

    # Orders

    async def plug(self) -> None:
        """Make the port, under another number each time."""
        self._spare.append(os.openpty())
        self._line = TortureLine(self.bus, link=self._table.port)
        await self._line.start()
        for fds in self._spare[:-1]:
            for fd in fds:
                os.close(fd)
        del self._spare[:-1]

    async def unplug(self) -> None:
        """Take the port away."""
        await self._line.stop()

    async def deafen(self) -> None:
        """Let the port receive nothing until it is opened afresh."""
        self._line.go_deaf()

    async def flood(self, seconds: float, byte: int | None = None) -> None:
        """Fill the line."""
        self._line.flood(seconds, b"" if byte is None else bytes([byte]))

    async def fault(self, starter: str, number: int) -> None:
        """Let a fault happen."""
        self.units[starter].trip(number)

    async def keypad_reset(self, starter: str) -> None:
        """Reset the fault at the starter."""
        self.units[starter].reset_at_keypad()

    async def mark(self) -> None:
        """Judge from now on."""
        self.bus.advance()
        self._marked_s = asyncio.get_running_loop().time()
        self.bus.violations.clear()

    async def report(self, values: bool = False) -> dict[str, Any]:
        """Report what has happened since the mark (start frames: since the beginning)."""
        self.bus.advance()
        now_s = asyncio.get_running_loop().time()
        late_s = list(self._late_s)
        found: dict[str, Any] = {
            "violations": [  # but those at times when we ourselves were late
                [each.at_s, str(each)]
                for each in self.bus.violations
                if not any(abs(each.at_s - at_s) < LATE_AROUND_S for at_s in late_s)
            ],
            "starters": {name: self._of(name, now_s) for name in self.units},
        }
        if values:
            for name, truth in self.truths.items():
                found["starters"][name]["values"] = {
                    point: list(seen) for point, seen in truth.values.items()
                }
        return found

    async def written(self, starter: str, since_s: float) -> dict[str, Any]:
        """Report what was written to a starter since then; cheap, however long this has run."""
        self.bus.advance()
        recent = takewhile(lambda write: write.at_s >= since_s, reversed(self.units[starter].writes))
        return {"writes": [[write.at_s, write.pdu.hex()] for write in recent][::-1]}

    async def watch_own_lateness(self) -> None:
        """Note when this process did not get its time, until cancelled."""
        loop = asyncio.get_running_loop()
        while True:
            due_s = loop.time() + LATE_TICK_S
            await asyncio.sleep(LATE_TICK_S)
            if loop.time() - due_s > LATE_S:
                self._late_s.append(loop.time())

    def _of(self, name: str, now_s: float) -> dict[str, Any]:
        unit, truth = self.units[name], self.truths[name]
        requests_s = [at_s for at_s in truth.requests_s if at_s >= self._marked_s]
        before_s = [at_s for at_s in truth.requests_s if at_s < self._marked_s][-1:]
        return {
            "trips": [
                [t.at_s, t.code] for t in unit.trips if t.at_s >= self._marked_s and t.code in SILENCE_TRIPS
            ],
            "start_frames": len(unit.start_frames),
            "requests": len(requests_s),
            "gaps": sorted(pairwise([*before_s, *requests_s, now_s]), key=lambda gap: gap[0] - gap[1])[:GAPS],
            "is_on": unit.motor.is_turned_on,
        }


def watching_unit(family: str, address: int, watchdog_s: int) -> SimulatedUnit:
    """Return a starter that watches its line, but only says so."""
    weg = {P_TIMEOUT: watchdog_s, P_ACTION: ACTION_NONE}
    settings = {
        "ssw06": weg,
        "ssw07": weg,
        "ssw900": {C8_TIMEOUT_MODE: ALARM_ONLY, C8_TIMEOUT_ACTION: INDICATE, C8_TIMEOUT: 10 * watchdog_s},
    }
    unit: Any = make_unit(family, address, seed=address, settings=settings.get(family, {}))
    if family == "sst":  # it counts from the first command
        unit.settings[sst_registers.TIMEOUT_STOP] = min(watchdog_s, 255)
    return unit


class StartersProcess:
    """The process seen from outside."""

    def __init__(self, config: Path, watchdog_s: int) -> None:
        self._arguments = ("tests.lab.torture.starters", str(config), str(watchdog_s))
        self._process: asyncio.subprocess.Process

    async def start(self) -> None:
        pipes = {"stdin": asyncio.subprocess.PIPE, "stdout": asyncio.subprocess.PIPE, "limit": 2**26}
        self._process = await asyncio.create_subprocess_exec(sys.executable, "-m", *self._arguments, **pipes)
        await self._answer()

    async def order(self, do: str, **arguments: Any) -> dict[str, Any]:
        """Give an order and return the answer."""
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps({"do": do, **arguments}).encode() + b"\n")
        return await self._answer()

    async def stop(self) -> None:
        if self._process.returncode is None:
            self._process.terminate()
            await self._process.wait()

    async def _answer(self) -> dict[str, Any]:
        assert self._process.stdout is not None
        async with asyncio.timeout(20.0):
            answer: dict[str, Any] = json.loads(await self._process.stdout.readline())
        return answer


async def serve(config: str, watchdog_s: int) -> None:
    (table,) = load(config).lines
    plant = StarterLine(table, watchdog_s)
    await plant.plug()
    watching = asyncio.create_task(plant.watch_own_lateness())
    reader = asyncio.StreamReader()
    loop = asyncio.get_running_loop()
    await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), sys.stdin)
    print(json.dumps({"ready": True}), flush=True)
    while line := await reader.readline():
        order = json.loads(line)
        answer = await getattr(plant, order.pop("do"))(**order)
        print(json.dumps(answer or {}), flush=True)
    watching.cancel()


if __name__ == "__main__":
    asyncio.run(serve(sys.argv[1], int(sys.argv[2])))
