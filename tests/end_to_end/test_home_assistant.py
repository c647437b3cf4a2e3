"""Home Assistant's discovery with real processes: announced, pressed, lost, reloaded and deleted."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import AsyncIterator, Collection
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

from tests.end_to_end.site import Program, Scada, site_config, write_config
from tests.home_assistant.announced import Rendering
from tests.mosquitto import MosquittoBroker, StartMosquitto, Watcher

TABLE = '\n[homeassistant]\noperator = "home-assistant"\ncommands = true\n'
OPERATOR = '\n[[operator]]\nclient = "home-assistant"\nmay = ["start", "stop"]\nstarters = ["*"]\n'
PUMP = '\n[[line.starter]]\nname = "pump"\naddress = 1\nfamily = "ssw07"\nevery_s = 0.2\n'
FAN = '\n[[line.starter]]\nname = "fan"\naddress = 2\nfamily = "ssw06"\nevery_s = 0.2\n'
FILTER = "homeassistant/#"
TOPICS = {f"homeassistant/device/sg_plant{each}/config" for each in ("", "_pump", "_fan")}


@asynccontextmanager
async def announcing(
    broker: MosquittoBroker, folder: Path
) -> AsyncIterator[tuple[Scada, Program, Path, Watcher]]:
    starters = PUMP + FAN + OPERATOR
    text = site_config(broker_port=broker.port, port=str(folder / "ttyHALL"), starters=starters)
    config = write_config(folder, text.replace("[mqtt]", 'clock = "trusted"\n\n[mqtt]') + TABLE)
    async with (
        Program("gateway", "simulate", str(config)) as simulator,
        broker.watch("starters/plant/#") as watcher,
        broker.watch(FILTER) as discovery,
    ):
        await simulator.says("line hall")
        async with Program("gateway", "run", str(config)) as gateway:
            scada = Scada(broker, watcher, client="home-assistant")
            await scada.ready("pump")
            yield scada, gateway, config, discovery


async def seen(watcher: Watcher, topics: Collection[str], *, deleted: Collection[str] = ()) -> dict[str, Any]:
    """Wait until these topics were announced and those deleted, from now on; return what was announced."""
    found: dict[str, Any] = {}
    async with asyncio.timeout(20.0):
        while not {*topics, *deleted} <= set(found):
            message = await watcher.next(within_s=20.0)
            if message.topic in (topics if message.payload else deleted):
                found[message.topic] = json.loads(message.payload) if message.payload else None
    return found


def press(button: dict[str, Any], rendering: Rendering) -> tuple[str, str]:
    """Return topic and payload of a press at the rendering's time, without the base."""
    template = button.get("command_template")
    payload = button["payload_press"] if template is None else rendering.command(template)
    return button["command_topic"].removeprefix("starters/plant/"), payload


async def test_a_press_starts_and_stops_the_motor_and_a_copy_or_a_late_one_does_nothing(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    async with announcing(start_mosquitto(), tmp_path) as (scada, _, _, discovery):
        found = await seen(discovery, TOPICS)
        buttons = found["homeassistant/device/sg_plant_pump/config"]["components"]
        rendering = Rendering(seed=time.time_ns())

        rendering.utc_s = time.time() - 60.0
        topic, late = press(buttons["start"], rendering)
        await scada.publish(topic, late)
        await scada.result("pump", id=json.loads(late)["id"], phase="rejected", code="expired")
        await asyncio.sleep(2.1)  # after the connection: this clock might be ahead of the gateway's
        rendering.utc_s = time.time()
        topic, start = press(buttons["start"], rendering)
        await scada.publish(topic, start)
        await scada.result("pump", id=json.loads(start)["id"], phase="confirmed")
        await scada.publish(*press(buttons["stop"], rendering))
        await scada.result("pump", verb="stop", phase="confirmed")
        await scada.publish(topic, start)
        copy = await scada.result("pump", id=json.loads(start)["id"], duplicate=True)
        await scada.until("starter/pump/state", running=False)

    assert "reset" not in buttons  # no right to it
    assert copy["phase"] in ("confirmed", "rejected")
