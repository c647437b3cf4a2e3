"""The demo under test: the whole of it as a process of its own."""

from __future__ import annotations

import re
import signal
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager
from pathlib import Path

from tests.end_to_end.site import Program, Scada
from tests.mosquitto import MosquittoBroker

STARTERS = ("pump", "fan", "mill", "belt")


@asynccontextmanager
async def demo(
    folder: Path,
    *,
    environ: Mapping[str, str] | None = None,
    on_guide: Callable[[str], None] = lambda _: None,
) -> AsyncIterator[Scada]:
    """Run the demo and wait until all four starters are ready; `on_guide` gets what it has printed."""
    async with Program("gateway", "demo", environ=environ) as program:
        await program.says("others    simulator/")
        port = re.search(r"on 127\.0\.0\.1:(\d+)", program.output)
        assert port is not None
        on_guide(program.output)
        broker = MosquittoBroker(folder / "unused")  # only its clients: the demo has a broker of its own
        broker.port = int(port[1])
        broker.version = "mqttv311" if "amqtt (embedded" in program.output else broker.version
        async with broker.watch("starters/demo/#", "simulator/+/done") as watcher:
            scada = Scada(broker, watcher, base="starters/demo", client="demo")
            for starter in STARTERS:
                await scada.ready(starter)
            yield scada
        program.signal(signal.SIGINT)
        assert await program.exit_code() == 0
