"""The page of a running gateway: live values, commands, why not, reload; the lines notice nothing of it."""

from __future__ import annotations

import asyncio
import json
import signal
import socket
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Any

from gateway.system.password_hash import password_line
from tests.end_to_end.site import Program, Scada, site_config, write_config
from tests.end_to_end.web.raw_client import WebClient
from tests.mosquitto import MosquittoBroker, StartMosquitto, free_port

PASSWORD = "correct horse"
LINE = password_line(PASSWORD)
USER = f'[[web.user]]\nname = "anna"\npassword = "{LINE}"\noperator = "alice"\n'


class PagedSite:
    """A gateway with a page, a client of it, and what MQTT sees."""

    def __init__(self, gateway: Program, config: Path, scada: Scada, web: WebClient) -> None:
        self.gateway, self.config, self.scada, self.web = gateway, config, scada, web
        self.text = config.read_text("utf-8")

    async def reload(self, text: str, code: str = "reloaded") -> None:
        self.scada.latest.pop("gateway/event", None)
        self.config.write_text(text, "utf-8")
        self.gateway.signal(signal.SIGHUP)
        await self.scada.until("gateway/event", code=code)

    async def until_served(self, *, is_served: bool = True) -> None:
        async with asyncio.timeout(20.0):
            while True:
                with suppress(OSError):
                    await self.web.get("/api/v1/session")
                    if is_served:
                        return
                    await asyncio.sleep(0.1)
                    continue
                if not is_served:
                    return
                await asyncio.sleep(0.1)


def permitted(seen: list[tuple[str, Any]], verb: str) -> list[str]:
    """Return, in their order, the codes of what forbade a command so far; empty ones where nothing did."""
    return [offer["code"] for _, data in seen for offer in data.get("actions") or () if offer["verb"] == verb]


async def until(is_so: Callable[[], bool], *, within_s: float = 20.0) -> None:
    """Wait for something that is seen in the stream; what is permitted is looked at once a second."""
    async with asyncio.timeout(within_s):
        while not is_so():  # noqa: ASYNC110 - of another process
            await asyncio.sleep(0.05)


@asynccontextmanager
async def paged(broker: MosquittoBroker, folder: Path, web: str = "") -> AsyncIterator[PagedSite]:
    """Run simulator and gateway with a page."""
    port = free_port()
    text = site_config(broker_port=broker.port, port=str(folder / "ttyHALL"))
    table = web or f'[web]\nlisten = "127.0.0.1:{port}"\n{USER}'
    config = write_config(folder, f"{text}\n{table}")
    async with (
        Program("gateway", "simulate", str(config)) as simulator,
        broker.watch("starters/plant/#") as watcher,
    ):
        await simulator.says("line hall")
        async with Program("gateway", "run", str(config)) as gateway:
            scada = Scada(broker, watcher)
            await scada.ready("pump")
            site = PagedSite(gateway, config, scada, WebClient(port))
            await site.until_served()
            yield site


async def test_a_start_and_a_stop_from_the_page_are_those_of_its_operator_and_are_seen_live(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    async with paged(start_mosquitto(), tmp_path) as site:
        web, seen = site.web, []
        assert (await web.log_in("anna", "wrong horse")).status == 401
        assert (await web.log_in("anna", PASSWORD)).status == 200

        async def look() -> None:
            async for name, data in web.events("/api/v1/events?starter=pump"):
                seen.append((name, data))

        looking = asyncio.create_task(look())
        [*_, selected] = await web.command("pump", "select", "s1", args={"verb": "start"})
        phases = await web.command("pump", "start", "c1", select=selected["select"])
        result = await site.scada.result("pump", id="c1", phase="confirmed")
        audit = await site.scada.until("audit", id="c1")
        await until(lambda: "motor_running" in permitted(seen, "start"))
        stop = (await web.post("/api/v1/command/pump/stop")).json
        await until(lambda: permitted(seen, "start")[-1:] == [""])
        looking.cancel()
        await asyncio.gather(looking, return_exceptions=True)
        old = await web.post("/api/v1/command/pump/start", {"id": "c2", "token": "of-a-dead-stream"})
        journal = site.gateway.output

    assert [each["phase"] for each in phases] == ["accepted", "written", "confirmed"]
    assert phases[-1] == {key: value for key, value in result.items() if key in phases[-1]}
    assert (audit["client"], audit["operator"], audit["source"]) == ("alice", "anna", "web")
    assert stop["final"]
    assert stop["phases"][-1]["phase"] == "confirmed"
    assert old.json["phases"][-1]["code"] == "not_fresh"
    assert seen[0][0] == "snapshot"
    messages = [each for name, data in seen if name == "change" for each in data["messages"]]
    assert {"c1"} <= {each["payload"].get("id") for each in messages if each["topic"] == "result/pump/alice"}
    states = [
        data["topics"]["starter/pump/state"]["state"]
        for _, data in seen
        if "starter/pump/state" in data.get("topics", {})
    ]
    assert "starting" in states or "running" in states
    assert {"motor_running", ""} <= set(permitted(seen, "start"))
    assert "web login: user=anna client=alice" in journal
    assert PASSWORD not in journal


async def test_a_port_that_is_taken_is_an_event_and_the_gateway_polls_all_the_same(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        broker = start_mosquitto()
        text = site_config(broker_port=broker.port, port=str(tmp_path / "ttyHALL"))
        config = write_config(tmp_path, f'{text}\n[web]\nlisten = "127.0.0.1:{port}"\n')
        async with (
            Program("gateway", "simulate", str(config)) as simulator,
            broker.watch("starters/plant/#") as watcher,
        ):
            await simulator.says("line hall")
            async with Program("gateway", "run", str(config)):
                scada = Scada(broker, watcher)
                await scada.ready("pump")
                event = await scada.until("gateway/event", code="web_away")

    assert "Address already in use" in event["text"]


async def test_check_doctor_and_diagnostics_of_a_running_gateway_hold_no_secret(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    async with paged(start_mosquitto(), tmp_path) as site:
        await site.web.log_in("anna", PASSWORD)
        site.web.patience_s = 60.0  # the tools yield to every other process
        check = (await site.web.post("/api/v1/check")).json
        rows: list[dict[str, Any]] = (await site.web.get("/api/v1/starter/pump/parameters")).json["rows"]
        diagnostics = await site.web.get("/api/v1/diagnostics.json")

    assert check["code"] == 0
    assert "valid, 4 starters" in check["output"]
    named = {row["code"]: row for row in rows}
    assert named["P314"]["writable"]
    assert not named["P003"]["writable"]
    assert LINE.rpartition("$")[2] not in diagnostics.body.decode()
    assert json.loads(diagnostics.body)["config"]["web"]["user"][0]["password"] == "(left out)"
