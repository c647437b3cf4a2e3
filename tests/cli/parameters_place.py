"""A simulated starter on a line of its own, for saving and restoring."""

from __future__ import annotations

import asyncio
import io
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any

from gateway.cli.command import Progress
from gateway.cli.parameters.live import LiveStarter, save
from gateway.cli.parameters.restore import restore
from gateway.families.profile.load import load_profile
from gateway.families.profile.schema import Variant
from gateway.line.rtu.reply_times import ALLOWANCE_S
from gateway.modbus.timing import Framing, LineTiming
from gateway.sim.bus.port import SimulatedLine
from gateway.sim.core.unit import SimulatedUnit
from gateway.starters.parameters.model import ParameterEntry, ParameterSet
from gateway.starters.setup import StarterSetup
from tests.virtual_time import VirtualClock

TIMING = LineTiming(19200, Framing.parse("8E1"))
SST_TIMING = LineTiming(19200, Framing.parse("8N2"))
RUNNERS: list[asyncio.Runner] = []  # that of the present test, see conftest.py


class ParametersPlace:
    """One simulated starter on a line of its own, and what is said of it."""

    def __init__(self, unit: SimulatedUnit, *, family: str = "", address: int = 1) -> None:
        self.unit: Any = unit
        self.timing = SST_TIMING if unit.family == "sst" else TIMING
        self.bus = SimulatedLine(self.timing, [unit], frames_stored=100_000)
        self.setup = StarterSetup("pump", "pumps", address, load_profile(family or unit.family), Variant())
        self.said = io.StringIO()
        self.took_s = 0.0
        self.state_dir = Path("of no gateway")
        self.neighbours: tuple[StarterSetup, ...] = ()

    def run(self, work: Callable[[LiveStarter, Progress], Coroutine[Any, Any, Any]]) -> Any:
        async def main() -> Any:
            loop = asyncio.get_running_loop()
            clock, opener = VirtualClock(loop), self.bus.opener()
            live = LiveStarter(
                self.setup, opener, self.timing, ALLOWANCE_S, clock, self.state_dir, self.neighbours
            )
            began_s = loop.time()
            try:
                return await work(live, Progress(self.said))
            finally:
                self.took_s = loop.time() - began_s

        return RUNNERS[-1].run(main())

    def save(self, **options: Any) -> ParameterSet:
        saved: ParameterSet = self.run(lambda live, progress: save(live, progress, **options))
        return saved

    def restore(self, wanted: dict[str, Any], *, model: str | None = None, **options: Any) -> int:
        entries = {code: ParameterEntry(value=value) for code, value in wanted.items()}
        file = ParameterSet("other", self.setup.profile.family, model=model, parameters=entries)
        code: int = self.run(lambda live, progress: restore(live, file, progress, **options))
        return code

    @property
    def written(self) -> list[bytes]:
        return [write.pdu for write in self.unit.writes]
