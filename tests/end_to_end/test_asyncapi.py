"""Every message of a run with all integrations is one that docs/reference/asyncapi.yaml describes."""

from __future__ import annotations

import asyncio
import json
import re
import signal
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
import yaml
from jsonschema import Draft7Validator

from gateway.system.password_hash import password_line
from tests.end_to_end.site import FOUR_FAMILIES, Program, Scada, site_config, write_config
from tests.end_to_end.web.raw_client import WebClient
from tests.mosquitto import MosquittoBroker, Seen, StartMosquitto, free_port
from tests.reference.asyncapi import payload_schema
from tests.reference.pages import FOLDER
from tests.reference.topics import TOPICS
from tests.sparkplug.support import dcmd, write

BASE = "starters/plant"
PASSWORD = "correct horse"
INTEGRATIONS = f"""
[web]
listen = "127.0.0.1:{{web}}"
[[web.user]]
name = "anna"
password = "{password_line(PASSWORD)}"
operator = "alice"

[metrics]

[homeassistant]
operator = "alice"
commands = true

[sparkplug]
group = "plant"
commands = true
operator = "alice"
"""
BELT = FOUR_FAMILIES[FOUR_FAMILIES.index('\n[[line.starter]]\nname = "belt"') : FOUR_FAMILIES.index("[[oper")]
STOP = dcmd(write("Command/Stop"), time_s=None).decode("ascii")


@dataclass
class Reader(Scada):
    """Remembers every message."""

    found: list[Seen] = field(default_factory=list)

    def _take(self, seen: Seen) -> None:
        self.found.append(seen)
        super()._take(seen)


class Described:
    """The messages of the file below one base."""

    def __init__(self) -> None:
        whole = yaml.safe_load((FOLDER / "reference" / "asyncapi.yaml").read_text("utf-8"))
        self.channels: dict[str, dict[str, Any]] = whole["channels"]
        self._schemas = {
            name: Draft7Validator(each["payload"]) for name, each in whole["components"]["messages"].items()
        }
        # The file permits fields that it does not name, for later versions; this one has none.
        self._closed = {
            topic.name: Draft7Validator(payload_schema(topic, is_closed=True)) for topic in TOPICS
        }
        self._delivery = {
            each["channel"]["$ref"].rpartition("/")[2]: each["bindings"]["mqtt"]
            for each in whole["operations"].values()
        }

    def channel_of(self, topic: str) -> str:
        """Return which channel a topic is of; empty for none."""
        for name, channel in self.channels.items():
            address = channel["address"].replace("{base}", BASE)
            if re.fullmatch(re.sub(r"{\w+}", "[a-z0-9_-]+", address), topic):
                return name
        return ""

    def problems(self, seen: Seen) -> Iterator[str]:
        """Yield what is not as the file says."""
        name = self.channel_of(seen.topic)
        if not name:
            yield f"{seen.topic}: no channel"
            return
        how = self._delivery[name]
        if (seen.qos, seen.retain) != (how["qos"], how["retain"]):
            yield f"{seen.topic}: QoS {seen.qos}, retained: {seen.retain}"
        kind, value = (name, json.loads(seen.payload)) if seen.payload else ("deleted", "")
        if kind not in self.channels[name]["messages"]:
            yield f"{seen.topic}: an empty payload"
            return
        closed = self._closed.get(kind, self._schemas[kind])
        for error in (*self._schemas[kind].iter_errors(value), *closed.iter_errors(value)):
            yield f"{seen.topic}: {'.'.join(map(str, error.path))}: {error.message[:200]}"


async def run_of_everything(broker: MosquittoBroker, folder: Path) -> list[Seen]:
    """Return all messages of a run with commands by every way, a trip, and a reload without the belt."""
    web_port = free_port()
    site = site_config(broker_port=broker.port, port=str(folder / "ttyHALL"))
    text = site.replace("[mqtt]", 'clock = "trusted"\n\n[mqtt]') + INTEGRATIONS.format(web=web_port)
    config = write_config(folder, text)
    knobs = ("--knobs", f"mqtt://127.0.0.1:{broker.port}")
    async with (
        Program("gateway", "simulate", str(config), *knobs) as simulator,
        broker.watch(f"{BASE}/#", options=("--retain-as-published",)) as watcher,
    ):
        await simulator.says("line hall")
        async with Program("gateway", "run", str(config)) as gateway:
            scada = Reader(broker, watcher)
            await scada.ready("pump")
            await scada.ready("mill")
            await scada.command("pump", "start", "a")
            await scada.result("pump", id="a", phase="confirmed")
            await scada.command("pump", "start", "b")
            await scada.result("pump", id="b", phase="rejected")
            await scada.command("mill", "read", "c", parameter="S1.1.1")
            await scada.result("mill", id="c", phase="confirmed")
            await scada.set_knob("pump", "trip", "5")
            await scada.until("starter/pump/state", state="fault", fault_code=5)
            await asyncio.to_thread(broker.publish, "spBv1.0/plant/DCMD/plant/pump", STOP)
            await scada.result("pump", verb="stop", phase="confirmed")
            page = WebClient(web_port)
            await page.log_in("anna", PASSWORD)
            await page.command("pump", "reset", "d")
            await scada.until("starter/pump/alarm/e05", active=False)
            config.write_text(text.replace(BELT, "\n"), "utf-8")
            gateway.signal(signal.SIGHUP)
            await scada.until("gateway/event", code="reloaded")
            gateway.signal(signal.SIGTERM)
            assert await gateway.exit_code() == 0, gateway.output
        await scada.until("gateway/status", state="offline")
    return scada.found


@pytest.mark.long
async def test_every_message_of_a_run_with_all_integrations_is_as_the_file_says(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    described = Described()

    found = await run_of_everything(start_mosquitto(), tmp_path)

    problems = [problem for seen in found for problem in described.problems(seen)]
    assert problems[:5] == []
    events = {json.loads(each.payload)["code"] for each in found if each.topic == f"{BASE}/gateway/event"}
    assert "sparkplug_born" in events
    decisions = [json.loads(each.payload) for each in found if each.topic == f"{BASE}/audit"]
    assert {each.get("source") for each in decisions} == {None, "sparkplug", "web"}
    assert any(each.topic.startswith(f"{BASE}/starter/belt/") and not each.payload for each in found)
    # A record of a start or a trip comes once it is over, late values only after an outage.
    seldom = {"starterTrip", "starterStart", "starterHistory"}
    assert described.channels.keys() - {described.channel_of(each.topic) for each in found} <= seldom
