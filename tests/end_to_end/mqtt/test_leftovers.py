"""Ghosts at a real Mosquitto: what earlier runs left retained, and another gateway under one base."""

from __future__ import annotations

import asyncio
import json
import signal
from pathlib import Path

import pytest

from tests.end_to_end.site import Program, Scada, site_config, write_config
from tests.mosquitto import MosquittoBroker, Seen, StartMosquitto

BASE = "starters/plant"
TWO = """
[[line.starter]]
name = "pump"
address = 1
family = "ssw07"
every_s = 0.2

[[line.starter]]
name = "fan"
address = 2
family = "ssw07"
every_s = 0.2

[[operator]]
client = "alice"
may = ["*"]
starters = ["*"]
"""


async def retained(broker: MosquittoBroker) -> dict[str, str]:
    """Return what the broker retains below the base."""
    async with broker.watch(f"{BASE}/#") as watcher:
        await asyncio.to_thread(broker.publish, f"{BASE}/end", "x")
        seen: list[Seen] = await watcher.until(lambda each: each.topic == f"{BASE}/end")
    return {each.topic.removeprefix(f"{BASE}/"): each.payload for each in seen if each.retain}


@pytest.mark.long
async def test_ended_alarms_and_a_renamed_starter_are_gone_when_the_next_run_is_online(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    broker = start_mosquitto()
    text = site_config(broker_port=broker.port, port=str(tmp_path / "ttyHALL"), starters=TWO)
    config = write_config(tmp_path, text)
    url = f"mqtt://127.0.0.1:{broker.port}"
    async with Program("gateway", "simulate", str(config), "--knobs", url) as simulator:
        await simulator.says("line hall")
        async with Program("gateway", "run", str(config)) as gateway, broker.watch(f"{BASE}/#") as watcher:
            scada = Scada(broker, watcher)
            await scada.ready("pump")
            await scada.ready("fan")
            for starter in ("pump", "fan"):
                await scada.set_knob(starter, "trip", "E05")
                await scada.until(f"starter/{starter}/alarm/e05", active=True)
            gateway.signal(signal.SIGKILL)
            await gateway.exit_code()
            await scada.until("gateway/status", state="offline")
        await asyncio.to_thread(broker.publish, f"{BASE}/starter/fan/note", '{"by":"others"}', "-r")
        before = await retained(broker)
        await scada.set_knob("pump", "clear", "")
        write_config(tmp_path, text.replace('"fan"', '"blower"'))
        async with Program("gateway", "run", str(config)), broker.watch(f"{BASE}/#") as watcher:
            scada = Scada(broker, watcher)
            await scada.until("gateway/status", state="starting")
            await scada.until("gateway/status", state="online")
            after = await retained(broker)

    gone = [topic for topic in before if topic.startswith("starter/fan/")]
    assert len(gone) > 30
    assert json.loads(before["starter/pump/alarm/e05"])["active"] is True
    assert "starter/pump/alarm/e05" not in after
    assert [topic for topic in after if topic.startswith("starter/fan/")] == ["starter/fan/note"]
    assert json.loads(after["starter/blower/alarm/e05"])["active"] is True
