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


@pytest.mark.long
async def test_two_gateways_under_one_base_both_say_so_and_clear_nothing(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    broker = start_mosquitto()
    configs = []
    for name, starters in (("one", TWO), ("two", TWO.replace('"fan"', '"blower"'))):
        (tmp_path / name).mkdir()
        text = site_config(broker_port=broker.port, port=str(tmp_path / name / "ttyHALL"), starters=starters)
        configs.append(write_config(tmp_path / name, text.replace("[mqtt]", f'[mqtt]\nclient_id = "{name}"')))
    async with (
        Program("gateway", "simulate", str(configs[0])) as first_line,
        Program("gateway", "simulate", str(configs[1])) as second_line,
        broker.watch(f"{BASE}/#") as watcher,
    ):
        await first_line.says("line hall")
        await second_line.says("line hall")
        scada = Scada(broker, watcher)
        async with Program("gateway", "run", str(configs[0])) as first:
            await scada.ready("fan")
            await scada.until("gateway/status", state="online")
            async with Program("gateway", "run", str(configs[1])) as second:
                said = f"another gateway publishes below {BASE} too"
                await first.says(said)
                await second.says(said)
                await scada.until("gateway/event", code="base_shared", severity="error")
                await scada.until("starter/blower/state", quality="good")
                left = await retained(broker)

    assert "starter/fan/state" in left


@pytest.mark.long
async def test_where_the_broker_denies_reading_that_is_an_event_and_a_stop_works_meanwhile(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    branches = ("gateway/#", "starter/#", "result/#", "audit")
    writes = "".join(f"topic write {BASE}/{each}\n" for each in branches)
    broker = start_mosquitto(
        users={"plant": "one", "alice": "two"},
        acl=f"user plant\ntopic read {BASE}/command/#\n{writes}\nuser alice\ntopic readwrite #\n",
    )
    text = site_config(broker_port=broker.port, port=str(tmp_path / "ttyHALL"), starters=TWO)
    config = write_config(tmp_path, text.replace("[mqtt]", '[mqtt]\nusername = "plant"'))
    alice = ("alice", "two")
    async with (
        Program("gateway", "simulate", str(config)) as simulator,
        broker.watch(f"{BASE}/#", user=alice) as watcher,
    ):
        await simulator.says("line hall")
        password = {"STARTER_GATEWAY_MQTT_PASSWORD": "one"}
        async with Program("gateway", "run", str(config), environ=password):
            scada = Scada(broker, watcher)
            await scada.until("starter/pump/state", quality="good")
            broker.publish(f"{BASE}/command/pump/alice/stop", "", "-r", user=alice)
            stopped = await scada.result("pump", phase="confirmed")
            status = scada.latest["gateway/status"]["state"]
            event = await scada.until("gateway/event", code="leftovers_unread")
            await scada.until("gateway/status", state="online")

    assert stopped["text"].endswith("every command but a live stop is refused")
    assert status == "starting"
    assert event["data"] == {"topics": [f"{BASE}/gateway/#", f"{BASE}/starter/#"]}
