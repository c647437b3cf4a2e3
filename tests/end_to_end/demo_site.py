"""The demo under test: the whole of it as a process of its own."""

from __future__ import annotations

import re
import signal
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager

from tests.end_to_end.site import Program, Scada

STARTERS = ("pump", "fan", "mill", "belt")


@asynccontextmanager
async def demo(
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
        async with Scada(int(port[1]), base="starters/demo", client="demo") as scada:
            for starter in STARTERS:
                await scada.ready(starter)
            yield scada
        program.signal(signal.SIGINT)
        assert await program.exit_code() == 0
