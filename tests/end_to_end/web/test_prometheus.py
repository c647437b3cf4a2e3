"""A real Prometheus scrapes a gateway with simulated starters, alerts, and answers the dashboard."""

from __future__ import annotations

import asyncio
import json
import re
import signal
import urllib.parse
import urllib.request
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

from tests.end_to_end.page.support import PagePlant, page_plant
from tests.end_to_end.site import FOUR_FAMILIES
from tests.metrics.contrib import RULES, panel_expressions
from tests.metrics.promtool import program, promtool
from tests.mosquitto import StartMosquitto, free_port

WITHIN_S = 20.0
TOKEN = "0123456789abcdef"
METRICS = '\n[metrics]\nall_points = true\ntoken_file = "metrics.token"\n'
CONFIG = """\
global: {{ scrape_interval: 1s, scrape_timeout: 1s, evaluation_interval: 1s }}
scrape_configs:
  - job_name: starter-gateway
    static_configs: [{{ targets: ["127.0.0.1:{port}"] }}]
    authorization: {{ credentials_file: "{folder}/metrics.token" }}
rule_files: ["{rules}"]
"""


class Prometheus:
    """A running Prometheus, and what it knows."""

    def __init__(self, port: int) -> None:
        self._url = f"http://127.0.0.1:{port}/api/v1"

    async def get(self, path: str, **query: str) -> Any:
        """Return the data of an answer; OSError when there is none."""
        url = f"{self._url}/{path}?{urllib.parse.urlencode(query)}"
        return await asyncio.to_thread(_data_at, url)

    async def query(self, expression: str) -> list[dict[str, Any]]:
        """Return the series of an instant query."""
        return list((await self.get("query", query=expression))["result"])

    async def until(
        self, expression: str, is_so: Callable[[list[dict[str, Any]]], bool]
    ) -> list[dict[str, Any]]:
        """Return what an expression gives, once it is so."""
        found: list[dict[str, Any]] = []
        async with asyncio.timeout(WITHIN_S):
            while True:
                try:
                    found = await self.query(expression)
                except OSError:
                    found = []  # it begins
                if is_so(found):
                    return found
                await asyncio.sleep(0.2)


def _data_at(url: str) -> Any:
    with urllib.request.urlopen(url, timeout=WITHIN_S) as answer:
        return json.load(answer)["data"]


def write_token(config: Path) -> None:
    path = config.with_name("metrics.token")
    path.write_text(f"{TOKEN}\n", "utf-8")
    path.chmod(0o600)


@asynccontextmanager
async def prometheus(folder: Path, port: int) -> AsyncIterator[Prometheus]:
    """Run a Prometheus that scrapes a page's port, with the alerts of deploy/contrib."""
    own = free_port()
    config = folder / "prometheus.yml"
    config.write_text(CONFIG.format(port=port, folder=folder, rules=RULES), "utf-8")
    process = await asyncio.create_subprocess_exec(
        program("prometheus"),
        f"--config.file={config}",
        f"--storage.tsdb.path={folder / 'tsdb'}",
        f"--web.listen-address=127.0.0.1:{own}",
        "--log.level=error",
        stdout=asyncio.subprocess.DEVNULL,
        stderr=asyncio.subprocess.DEVNULL,
    )
    try:
        yield Prometheus(own)
    finally:
        process.terminate()
        try:
            await asyncio.wait_for(process.wait(), WITHIN_S)
        except TimeoutError:
            process.kill()
            await process.wait()


def grafanas(expression: str) -> str:
    """Return an expression of the dashboard with all of each variable chosen."""
    return re.sub(r"\$(gateway|line|starter)\b", ".*", expression)


async def test_a_real_prometheus_scrapes_the_plant_alerts_and_answers_the_dashboard(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    program("prometheus")
    write_token(tmp_path / "site.toml")
    async with (
        page_plant(start_mosquitto(), tmp_path, starters=FOUR_FAMILIES + METRICS) as plant,
        prometheus(tmp_path, plant.port) as seen,
    ):
        await seen.until('up{job="starter-gateway"} == 1', bool)
        states = await seen.until("starter_gateway_starter_state == 1", lambda found: len(found) == 4)
        assert {each["metric"]["state"] for each in states} == {"ready"}
        assert len(await seen.query("starter_gateway_motor_current_amperes")) == 4
        assert len(await seen.query("starter_gateway_point_value")) > 60

        await act(plant)
        await seen.until('starter_gateway_starter_state{starter="fan", state="running"} == 1', bool)
        await seen.until('starter_gateway_commands_total{verb="start", phase="confirmed"} == 1', bool)
        await seen.until('starter_gateway_stop_latency_seconds_count{line="hall"} >= 1', bool)
        await seen.until('ALERTS{alertname="StarterFault", starter="pump", alertstate="firing"}', bool)
        await seen.until('ALERTS{alertname="StarterSilent", alertstate="pending"}', bool)
        assert await seen.query('starter_gateway_motor_current_amperes{starter="belt"}') == []

        for expression in panel_expressions():
            await seen.query(grafanas(expression))  # an error of Prometheus' is an OSError
        empty = [each for each in panel_expressions() if not await seen.query(grafanas(each))]
        assert [each for each in empty if not MAY_BE_EMPTY.search(each)] == []
        rules = (await seen.get("rules"))["groups"][0]["rules"]
        assert {rule["health"] for rule in rules} == {"ok"}
        text = await asyncio.to_thread(scraped, f"http://127.0.0.1:{plant.port}/metrics")
        assert promtool("check", "metrics", standard_input=text) == ""

        await switch_off(plant)
        await seen.until('up{job="starter-gateway"} == 0', bool)
        assert (await plant.scada.until("starter/fan/state", state="running"))["quality"] == "good"


# A trip's record is made some seconds later; what no request has lost, no message has waited for.
MAY_BE_EMPTY = re.compile("trips_total|outbox_oldest|commands_rejected")


async def act(plant: PagePlant) -> None:
    """Let one motor run, one trip, one stop, and one starter lose its supply."""
    await plant.scada.command("fan", "start", "1")
    await plant.scada.command("mill", "stop", "2")
    plant.scada.set_knob("pump", "trip", "E05")
    plant.scada.set_knob("belt", "power", "off")


async def switch_off(plant: PagePlant) -> None:
    """Take [metrics] out of the configuration, and reload."""
    text = plant.config.read_text("utf-8")
    plant.config.write_text(text.replace(METRICS, "\n"), "utf-8")
    plant.gateway.signal(signal.SIGHUP)
    await plant.scada.until("gateway/event", code="reloaded")


def scraped(url: str) -> bytes:
    """Return what a gateway answers to a scrape."""
    request = urllib.request.Request(url, headers={"Authorization": f"Bearer {TOKEN}"})
    with urllib.request.urlopen(request, timeout=WITHIN_S) as answer:
        return bytes(answer.read())
