"""The gateway as an edge node, with real processes: Mosquitto, simulated starters, an independent host."""

from __future__ import annotations

import asyncio
import json
import os
import signal
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

from tests.end_to_end.plant import plant
from tests.end_to_end.site import PUMP
from tests.end_to_end.sparkplug.judges import PYTHON, python_judges
from tests.mosquitto import MosquittoBroker, StartMosquitto
from tests.rig.sites import ALICE

PATIENCE_S = 20.0
SPARKPLUG = '\n[sparkplug]\ngroup = "plant"\ncommands = true\noperator = "alice"\ndatatypes_in_data = true\n'
HOST = Path(__file__).with_name("host_server.py")


class Host:
    """The independent host application as a process."""

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self._process = process
        self.seen: list[dict[str, Any]] = []

    @classmethod
    @asynccontextmanager
    async def at(cls, broker: MosquittoBroker) -> AsyncIterator[Host]:
        process = await asyncio.create_subprocess_exec(
            str(PYTHON),
            str(HOST),
            str(broker.port),
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            limit=2**20,
            env={**os.environ, "PROTOCOL_BUFFERS_PYTHON_IMPLEMENTATION": "python"},
        )
        host = cls(process)
        try:
            await host.until(lambda seen: seen["kind"] == "connected")
            yield host
        finally:
            process.kill()
            await process.communicate()

    async def until(self, is_wanted: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """Return the first further message that is wanted."""
        assert self._process.stdout is not None
        async with asyncio.timeout(PATIENCE_S):
            while line := await self._process.stdout.readline():
                if line.startswith(b"{"):
                    self.seen.append(json.loads(line))
                    if is_wanted(self.seen[-1]):
                        return self.seen[-1]
        raise AssertionError(f"the host ended: {self.seen[-3:]}")

    async def message(self, kind: str, **values: Any) -> dict[str, Any]:
        """Return the next message of a kind with these metrics."""

        def is_wanted(seen: dict[str, Any]) -> bool:
            metrics = seen.get("metrics", {})
            is_there = all(metrics.get(name, {}).get("value") == value for name, value in values.items())
            return f"/{kind}/" in seen.get("topic", "") and is_there

        return await self.until(is_wanted)

    async def write(self, name: str, value: Any, *, device: str | None = "pump") -> None:
        """Write a metric."""
        assert self._process.stdin is not None
        line = json.dumps({"node": "plant", "device": device, "name": name, "value": value})
        self._process.stdin.write(line.encode() + b"\n")
        await self._process.stdin.drain()


@python_judges
async def test_an_independent_host_sees_births_and_data_commands_the_starter_and_sees_deaths(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    broker = start_mosquitto()
    site = plant(broker, tmp_path, starters=PUMP + ALICE, names=("pump",), more=SPARKPLUG)
    async with Host.at(broker) as host, site as (scada, gateway, _):
        birth = await host.message("NBIRTH")
        device = await host.message("DBIRTH", **{"Properties/Hardware Make": "WEG"})
        assert birth["metrics"]["bdSeq"]["value"] == 0
        assert device["metrics"]["Command/Start"]["value"] is False

        await scada.ready("pump")
        await host.write("Node Control/Rebirth", True, device=None)
        again = await host.message("NBIRTH")
        await host.message("DBIRTH", state="ready")
        assert (int(again["seq"]), again["metrics"]["bdSeq"]["value"]) == (0, 0)

        await asyncio.sleep(2.1)  # after the birth: this clock might be ahead of the gateway's
        await host.write("Command/Start", True)
        await host.message("DDATA", **{"Command/Last/Verb": "start", "Command/Last/Phase": "confirmed"})
        await host.message("DDATA", state="running")
        await host.write("Command/Stop", True)
        await host.message("DDATA", **{"Command/Last/Verb": "stop", "Command/Last/Phase": "confirmed"})
        audit = await scada.until("audit", verb="stop", decision="confirmed")
        assert (audit["client"], audit["source"]) == ("alice", "sparkplug")

        scada.set_knob("pump", "power", "off")
        await host.message("DDEATH")
        scada.set_knob("pump", "power", "on")
        await host.message("DBIRTH")
        gateway.signal(signal.SIGTERM)
        death = await host.message("NDEATH")
        assert death["metrics"]["bdSeq"]["value"] == 0
        assert await gateway.exit_code() == 0
