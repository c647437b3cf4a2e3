"""Four SSW-07 whose currents rise step by step, in a process of their own: CONFIG WATCHDOG_S as arguments.

Each step is a current that no starter ever has again, so every published value can be traced to its step.
"""

from __future__ import annotations

import asyncio
import random
import sys
from dataclasses import dataclass, replace
from typing import Any

from gateway.config.schema import LineTable
from gateway.sim.bus.faults import Noisy, Reply
from gateway.sim.core.meter import Meter
from gateway.sim.weg.common import RUN
from gateway.sim.weg.ssw07 import Ssw07
from tests.lab.torture.starters import SILENCE_TRIPS, StarterLine, serve

STEP_S = 3.0
STEP_A = 0.6  # more than a deadband of 0.5 A; between them lie the steps of the other starters
FIRST_A = 10.0
APART_A = 0.1
LATE_S = (0.05, 1.0)
QUICK = {"ramp_up_s": 0.6, "ramp_down_s": 0.4, "coast_s": 0.4}


class StepMeter(Meter):
    """Shows the current that it was set to, without noise."""

    def __init__(self, unit: Ssw07, first_a: float) -> None:
        super().__init__(unit.motor)
        self._rated_a = unit.motor.data.rated_current_a
        self.level_a = first_a

    @property
    def current_pct(self) -> float:
        return 100.0 * self.level_a / self._rated_a


@dataclass(frozen=True)
class Overdue:
    """Answers between these times after the request, however long others wait."""

    after_s: tuple[float, float]

    def apply(self, reply: Reply, dice: random.Random) -> tuple[Reply, ...]:
        return (replace(reply, after_s=dice.uniform(*self.after_s)),)


class SteppingPlant(StarterLine):
    """One line, and the books of what its starters had."""

    def __init__(self, table: LineTable, watchdog_s: int) -> None:
        super().__init__(table, watchdog_s)
        self._meters: dict[str, StepMeter] = {}
        self._steps: dict[str, list[list[float]]] = {name: [] for name in self.units}
        self._running: dict[str, list[list[float]]] = {name: [] for name in self.units}
        self._away: dict[str, list[list[float]]] = {name: [] for name in self.units}
        for place, (name, unit) in enumerate(self.units.items()):
            assert isinstance(unit, Ssw07)
            unit.motor.data = replace(unit.motor.data, **QUICK)
            unit.meter = self._meters[name] = StepMeter(unit, FIRST_A + place * APART_A)
            self._book_running_of(name, unit)
        self._stepping = asyncio.create_task(self._step())

    # Orders

    async def run(self) -> dict[str, Any]:
        """Let all motors run, as from their keypads."""
        self.bus.advance()
        for name, unit in self.units.items():
            if not unit.motor.is_turned_on:
                unit.command |= RUN  # type: ignore[attr-defined] # all are SSW-07
                unit.motor.start()
                self._note_running(name)
        return {}

    async def halt(self, starter: str) -> dict[str, Any]:
        """Stop a motor, as from its keypad."""
        self.bus.advance()
        self.units[starter].command &= ~RUN  # type: ignore[attr-defined]
        self.units[starter].motor.stop()
        self._note_running(starter)
        return {}

    async def switch(self, starter: str, is_on: bool) -> dict[str, Any]:
        """Take a starter's control supply away, or give it back."""
        unit, now_s = self.units[starter], asyncio.get_running_loop().time()
        if is_on:
            unit.power_on()
            self._away[starter][-1][1] = now_s + unit.restart_s
        else:
            unit.power_off()
            self._away[starter].append([now_s, float("inf")])
        self._note_running(starter)
        return {}

    async def corrupt(self, late_share: float = 0.0, byte_error_rate: float = 0.0) -> dict[str, Any]:
        """Let so many replies be late, and so many bytes both ways be wrong."""
        for unit in self.units.values():
            if late_share:
                self.bus.impair(unit.address, Overdue(LATE_S), chance=late_share)
            else:
                self.bus.heal(unit.address)
        self.bus.noise = Noisy(1.0 - (1.0 - byte_error_rate) ** 0.125) if byte_error_rate else None
        return {}

    async def account(self) -> dict[str, Any]:
        """Report what happened to each starter; times are monotonic."""
        self.bus.advance()
        return {
            "starters": {name: self._account_of(name) for name in self.units},
            "violations": [[each.kind, each.detail] for each in self._violations()],
            "late": sum(at_s >= self._marked_s for at_s in self._late_s),
        }

    def _account_of(self, name: str) -> dict[str, Any]:
        unit = self.units[name]
        return {
            "steps": self._steps[name],
            "running": self._running[name],
            "away": self._away[name],
            "requests_s": list(self.truths[name].requests_s),
            "trips_s": [trip.at_s for trip in unit.trips if trip.code in SILENCE_TRIPS],
            "writes": [[write.at_s, write.pdu.hex()] for write in unit.writes],
        }

    # What happens by itself

    async def _step(self) -> None:
        loop = asyncio.get_running_loop()
        for name, meter in self._meters.items():
            self._steps[name].append([loop.time(), meter.level_a])
        while True:
            for name, meter in self._meters.items():
                await asyncio.sleep(STEP_S / len(self._meters))
                self.bus.advance()
                meter.level_a = round(meter.level_a + STEP_A, 1)
                self._steps[name].append([loop.time(), meter.level_a])

    def _book_running_of(self, name: str, unit: Ssw07) -> None:
        handle = unit.handle

        def handle_and_note(pdu: bytes, now_s: float) -> bytes | None:
            reply = handle(pdu, now_s)
            self._note_running(name)
            return reply

        unit.handle = handle_and_note  # type: ignore[method-assign] # that is the point of it

    def _note_running(self, name: str) -> None:
        is_running = float(self.units[name].motor.is_turned_on)
        known = self._running[name]
        if not known or known[-1][1] != is_running:
            known.append([asyncio.get_running_loop().time(), is_running])


if __name__ == "__main__":
    asyncio.run(serve(sys.argv[1], int(sys.argv[2]), SteppingPlant))
