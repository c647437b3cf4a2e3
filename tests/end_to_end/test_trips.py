"""A trip on its whole way: recorded, stored, delivered although the gateway was killed without a broker."""

from __future__ import annotations

import asyncio
import json
import signal
from pathlib import Path
from typing import Any

import comtrade
import pytest

from tests.end_to_end.site import Program, Scada, site_config, write_config
from tests.mosquitto import MosquittoBroker, StartMosquitto, Watcher

RUNS_S = 13.0  # before the trip
FINISHED_S = 17.0  # a record, at the latest


async def trip_of(watcher: Watcher, starter: str) -> dict[str, Any]:
    """Wait for the record of a trip."""
    async with asyncio.timeout(FINISHED_S + 10.0):
        while True:
            seen = await watcher.next(within_s=FINISHED_S)
            if seen.topic.endswith(f"starter/{starter}/trip"):
                assert not seen.retain
                return dict(json.loads(seen.payload))


async def trip(knobs: MosquittoBroker, starter: str, number: str) -> None:
    await asyncio.to_thread(knobs.publish, f"simulator/{starter}/trip", number)


async def export(config: Path, base: Path, *options: str) -> comtrade.Comtrade:
    async with Program(
        "gateway", "history", str(config), "pump", "--comtrade", str(base), *options
    ) as program:
        assert await program.exit_code() == 0, program.output
    return comtrade.load(f"{base}.cfg", f"{base}.dat")


@pytest.mark.long
async def test_a_trip_without_a_broker_is_delivered_after_a_kill(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    broker, knobs = start_mosquitto(), start_mosquitto()
    config = write_config(tmp_path, site_config(broker_port=broker.port, port=str(tmp_path / "ttyHALL")))
    url = f"mqtt://127.0.0.1:{knobs.port}"
    async with Program("gateway", "simulate", str(config), "--knobs", url) as simulator:
        await simulator.says("line hall")
        async with Program("gateway", "run", str(config)) as gateway:
            async with broker.watch("starters/plant/#") as w:
                scada = Scada(broker, w)
                await scada.ready("pump")
                await scada.command("pump", "start", "run")
                await scada.until("starter/pump/value/starts_total", value=1, quality="good")
                run = (await scada.until("gateway/status", state="online"))["run"]
                await asyncio.sleep(RUNS_S)
            broker.stop()
            await trip(knobs, "pump", "E05")
            await asyncio.sleep(FINISHED_S)
            gateway.signal(signal.SIGKILL)
            await gateway.exit_code()
        recording = await export(config, tmp_path / "trip")
        broker.start()
        async with broker.watch("starters/plant/#") as w, Program("gateway", "run", str(config)):
            record = await trip_of(w, "pump")
            scada = Scada(broker, w)
            await scada.until("starter/pump/value/trips_total", value=1, quality="good")

    assert (record["boot"], record["code"], record["state_before"]) == (run, "e05", "running")
    assert record["readings"]["t_s"][0] <= -10.0
    assert record["at_fault"]["P050"]["unit"] == "%"
    assert recording.rec_dev_id == f"trip {record['id']}"
    current = recording.analog[recording.analog_channel_ids.index("current")]
    assert max(current) > 10.0
