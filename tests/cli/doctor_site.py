"""A site for the doctor to look at."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from gateway.app.capacity import prospects_of
from gateway.cli.doctor.broker import BrokerAccess
from gateway.cli.doctor.machine import DoctorFinding
from gateway.cli.doctor.starters import LineCheckup
from gateway.config.convert import timing_of
from gateway.config.load import parse
from gateway.config.schema import Config
from gateway.sim.bus.port import SimulatedLine
from gateway.sim.core.unit import SimulatedUnit
from tests.virtual_time import VirtualClock, run_virtually

SITE = """
[gateway]
name = "plant"
state_dir = "{folder}"
[mqtt]
url = "mqtt://127.0.0.1:{port}"
{login}
[[line]]
name = "hall"
port = "/nowhere/tty"
baud = 19200
framing = "8N2"
{starters}
[[operator]]
client = "alice"
may = ["read"]
starters = ["pump*"]
"""


STARTER = '[[line.starter]]\nname = "{name}"\naddress = {address}\nfamily = "{family}"\n'


def site(*families: str, folder: str = "/tmp", port: int = 1, login: str = "") -> str:
    starters = [
        STARTER.format(name=f"pump-{address}", address=address, family=family)
        for address, family in enumerate(families or ("ssw07",), 1)
    ]
    return SITE.format(folder=folder, port=port, login=login, starters="\n".join(starters))


def problems_in(remarks: Iterable[DoctorFinding]) -> list[str]:
    return [f"{remark.where}: {remark.text}" for remark in remarks if remark.is_problem]


class NoBroker(BrokerAccess):
    """A running gateway as far as `read` goes: it gives these rows, or raises; `trouble` is what it knows."""

    trouble = ""

    def __init__(self, config: Config, rows: dict[str, int] | Exception) -> None:
        super().__init__(config, Path("/tmp"))
        self._given = rows

    async def known(self, starter: str) -> str:
        return self.trouble

    async def read(self, starter: str, codes: Iterable[str]) -> dict[str, tuple[int, ...]]:
        if isinstance(self._given, Exception):
            raise self._given
        return {code: (self._given[code],) for code in codes if code in self._given}


def examine(
    text: str,
    *units: SimulatedUnit,
    opener: Any = None,
    rows: dict[str, int] | Exception | None = None,
    corrupt: Callable[[SimulatedLine], object] = lambda _: None,
    state_dir: Path = Path("of no gateway"),
) -> list[DoctorFinding]:
    """Return what is said of the one line of a site."""
    config = parse(text, "site.toml")
    found: list[DoctorFinding] = []

    async def run() -> None:
        (prospect,) = prospects_of(config)
        bus = SimulatedLine(timing_of(prospect.table), units)
        corrupt(bus)
        broker = NoBroker(config, rows or {})
        clock = VirtualClock(asyncio.get_running_loop())
        line = opener or bus.opener()
        await LineCheckup(prospect, line, found.append, broker, clock, state_dir).run()

    run_virtually(run())
    return found
