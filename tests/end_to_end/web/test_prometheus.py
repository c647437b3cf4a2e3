"""A real Prometheus scrapes a gateway with simulated starters, alerts, and answers the dashboard."""

from __future__ import annotations

import json
import re
import urllib.parse
import urllib.request
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Any

from tests.end_to_end.page.support import page_plant
from tests.end_to_end.site import FOUR_FAMILIES, Program
from tests.metrics.contrib import RULES, panel_expressions
from tests.mosquitto import StartMosquitto, free_port
from tests.programs import program
from tests.waiting import until

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

    def get(self, path: str, **query: str) -> Any:
        """Return the data of an answer; OSError when there is none, or an error."""
        url = f"{self._url}/{path}?{urllib.parse.urlencode(query)}"
        with urllib.request.urlopen(url, timeout=20.0) as answer:
            return json.load(answer)["data"]

    async def until(self, expression: str, least: int = 1) -> None:
        """Wait until an instant query has so many series."""

        def is_so() -> bool:
            with suppress(OSError):  # it begins
                return len(self.get("query", query=expression)["result"]) >= least
            return False

        await until(is_so, expression)


@asynccontextmanager
async def prometheus(folder: Path, port: int) -> AsyncIterator[Prometheus]:
    """Run a Prometheus that scrapes a page's port, with the alerts of deploy/contrib."""
    own, config = free_port(), folder / "prometheus.yml"
    config.write_text(CONFIG.format(port=port, folder=folder, rules=RULES), "utf-8")
    files = (f"--config.file={config}", f"--storage.tsdb.path={folder / 'tsdb'}")
    options = (*files, f"--web.listen-address=127.0.0.1:{own}", "--log.level=error")
    async with Program(*options, program=(program("prometheus"),)):
        yield Prometheus(own)


async def test_a_real_prometheus_scrapes_the_plant_alerts_and_answers_the_dashboard(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    program("prometheus")
    token = tmp_path / "metrics.token"
    token.touch(0o600)
    token.write_text("0123456789abcdef\n", "utf-8")
    async with (
        page_plant(start_mosquitto(), tmp_path, starters=FOUR_FAMILIES + METRICS) as plant,
        prometheus(tmp_path, plant.port) as seen,
    ):
        await seen.until("starter_gateway_starter_state == 1", 4)
        await seen.until("starter_gateway_point_value", 61)

        await plant.scada.command("fan", "start", "1")
        plant.scada.set_knob("pump", "trip", "E05")
        await seen.until('starter_gateway_starter_state{starter="fan", state="running"} == 1')
        await seen.until('starter_gateway_commands_total{verb="start", phase="confirmed"} == 1')
        await seen.until('ALERTS{alertname="StarterFault", starter="pump", alertstate="firing"}')

        for expression in panel_expressions():
            of_all = re.sub(r"\$(gateway|line|starter)\b", ".*", expression)  # as Grafana does
            seen.get("query", query=of_all)  # an error of Prometheus' is an OSError
        rules = seen.get("rules")["groups"][0]["rules"]
        assert {rule["health"] for rule in rules} == {"ok"}
