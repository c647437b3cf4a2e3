"""Simulated starters in a process of their own: `python -m tests.lab.torture.starters CONFIG WATCHDOG_S`.

Orders come as lines of JSON on stdin; each gets one line of JSON on stdout. Every starter watches its line
(P314, C8.2.5.3, R41) and records when it would have tripped; what it did is read with `report`.
"""

from __future__ import annotations

import asyncio
import json
import os
import random
import sys
import tty
from collections import deque
from collections.abc import Iterable
from dataclasses import replace
from itertools import pairwise, takewhile
from typing import Any

from gateway.config.convert import timing_of
from gateway.config.reading import load
from gateway.config.schema import LineTable
from gateway.sim.bus.bus import Bus, BusViolation
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
GAPS_REPORTED = 20  # of each starter, the longest
QUICK = {"ramp_up_s": 0.6, "ramp_down_s": 0.4, "coast_s": 0.4}  # of the motors


class TortureLine(PtyLine):
    """A pty that can go deaf, be flooded, and come back under another number."""

    flooded_bytes = 0
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
            self.flooded_bytes += count
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
        self.units = {
            each.name: watching_unit(each.family, each.address, watchdog_s) for each in table.starters
        }
        for unit in self.units.values():
            unit.motor.data = replace(unit.motor.data, **QUICK)
        self.truths = {
            each.name: Truth(
                self.units[each.name],
                each.name,
                each.family,
                make_unit(each.family, each.address, seed=each.address),
            )
            for each in table.starters
        }
        self.bus = Bus(
            timing_of(table),
            self.units.values(),
            name=table.name,
            chunk_bytes=None,
            tolerance_s=TOLERANCE_S,
        )
        self._marked_s = 0.0
        self._late_s: deque[float] = deque(maxlen=10_000)  # when this process itself was late
        self._line: TortureLine | None = None
        self._spare: list[tuple[int, int]] = []

    # Orders

    async def plug(self) -> dict[str, Any]:
        """Make the port, under another number each time."""
        self._spare.append(os.openpty())
        self._line = TortureLine(self.bus, link=self._table.port)
        await self._line.start()
        for fds in self._spare[:-1]:
            for fd in fds:
                os.close(fd)
        del self._spare[:-1]
        return {"path": self._line.path}

    async def unplug(self) -> dict[str, Any]:
        """Take the port away."""
        assert self._line is not None
        await self._line.stop()
        return {}

    async def deafen(self) -> dict[str, Any]:
        """Let the port receive nothing until it is opened afresh."""
        assert self._line is not None
        self._line.go_deaf()
        return {}

    async def flood(self, seconds: float, byte: int | None = None) -> dict[str, Any]:
        """Fill the line."""
        assert self._line is not None
        self._line.flood(seconds, b"" if byte is None else bytes([byte]))
        return {}

    async def fault(self, starter: str, number: int) -> dict[str, Any]:
        """Let a fault happen."""
        self.units[starter].trip(number)
        return {}

    async def keypad_reset(self, starter: str) -> dict[str, Any]:
        """Reset the fault at the starter."""
        unit: Any = self.units[starter]
        unit.reset_at_keypad()
        return {}

    async def mark(self) -> dict[str, Any]:
        """Judge from now on."""
        self.bus.advance()
        self._marked_s = asyncio.get_running_loop().time()
        self.bus.violations.clear()
        return {}

    async def report(self, values: bool = False) -> dict[str, Any]:
        """Report what has happened since the mark (start frames: since the beginning)."""
        self.bus.advance()
        now_s = asyncio.get_running_loop().time()
        found: dict[str, Any] = {
            "violations": [[each.at_s, str(each)] for each in self._violations()],
            "starters": {name: self._of(name, now_s) for name in self.units},
        }
        if values:
            found["values"] = {
                name: {point: list(seen) for point, seen in truth.values.items()}
                for name, truth in self.truths.items()
            }
        return found

    async def written(self, starter: str, since_s: float) -> dict[str, Any]:
        """Report what was written to a starter since then; cheap, however long this has run."""
        self.bus.advance()
        recent = takewhile(lambda write: write.at_s >= since_s, reversed(self.units[starter].writes))
        return {"writes": [[write.at_s, write.pdu.hex()] for write in recent][::-1]}

    def _violations(self) -> list[BusViolation]:
        """Return the master's faults, but those at times when we ourselves were late."""
        late_s = list(self._late_s)
        return [
            each
            for each in self.bus.violations
            if not any(-LATE_AROUND_S < each.at_s - at_s < LATE_AROUND_S for at_s in late_s)
        ]

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
            "gaps": _longest_gaps([*before_s, *requests_s, now_s]),
            "first_s": requests_s[0] if requests_s else None,
            "last_s": truth.requests_s[-1] if truth.requests_s else None,
            "writes": [[w.at_s, w.pdu.hex()] for w in unit.writes if w.at_s >= self._marked_s],
            "is_on": unit.motor.is_turned_on,
        }


def watching_unit(family: str, address: int, watchdog_s: int) -> SimulatedUnit:
    """Return a starter that watches its line, but only says so."""
    if family in ("ssw06", "ssw07"):
        settings = {P_TIMEOUT: watchdog_s, P_ACTION: ACTION_NONE}
        return make_unit(family, address, seed=address, settings=settings)
    if family == "ssw900":
        timeout = {C8_TIMEOUT_MODE: ALARM_ONLY, C8_TIMEOUT_ACTION: INDICATE, C8_TIMEOUT: 10 * watchdog_s}
        return make_unit(family, address, seed=address, settings=timeout)
    unit: Any = make_unit(family, address, seed=address)
    unit.settings[sst_registers.TIMEOUT_STOP] = min(watchdog_s, 255)
    return unit  # type: ignore[no-any-return]


def _longest_gaps(times_s: Iterable[float]) -> list[tuple[float, float]]:
    """Return the begin and the end of the longest gaps."""
    return sorted(pairwise(times_s), key=lambda gap: gap[0] - gap[1])[:GAPS_REPORTED]


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
        print(json.dumps(answer), flush=True)
    watching.cancel()


if __name__ == "__main__":
    asyncio.run(serve(sys.argv[1], int(sys.argv[2])))
