"""A plant of simulated starters on a pty, a real Mosquitto, and the gateway as the service it will be."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

from tests.end_to_end.site import FOUR_FAMILIES, Program, Scada, site_config, write_config
from tests.mosquitto import MosquittoBroker

STARTERS = ("pump", "fan", "mill", "belt")


@asynccontextmanager
async def plant(
    broker: MosquittoBroker,
    folder: Path,
    *,
    starters: str = FOUR_FAMILIES,
    names: tuple[str, ...] = STARTERS,
    more: str = "",
    options: tuple[str, ...] = (),
) -> AsyncIterator[tuple[Scada, Program, Path]]:
    """Run simulator and gateway, and wait until the starters of these names are ready."""
    text = site_config(broker_port=broker.port, port=str(folder / "ttyHALL"), starters=starters)
    config = write_config(folder, text + more)
    async with (
        Program("gateway", "simulate", str(config), "--knobs", broker.url) as simulator,
        Scada(broker.port) as scada,
    ):
        await simulator.says("line hall")
        async with Program("gateway", "run", *options, str(config)) as gateway:
            for starter in names:
                await scada.ready(starter)
            yield scada, gateway, config
