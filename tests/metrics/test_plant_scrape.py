"""The metrics of four simulated starters of all families: complete, and alone with their faults."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest

from gateway.plugins.metrics.catalogue import PREFIX
from tests.metrics.contrib import expressions, metrics_in
from tests.metrics.promtool import promtool
from tests.rig import RigPlant
from tests.rig.sites import ALICE, FOUR, METRICS, SSW07, WEB
from tests.scenarios.plugins.doors import samples

PAGE = Path(__file__).parents[2] / "docs" / "metrics.md"


@pytest.fixture(scope="module")
def whole() -> str:
    """Return a scrape of a plant in which each counter has something to count."""
    with RigPlant(FOUR + ALICE + WEB + METRICS + "all_points = true\n") as plant:
        plant.run(until=3.0)
        plant.command("pump/alice/start", fresh=False)
        plant.command("pump/alice/stop")
        plant.run(until=5.0)
        plant.do(lambda: plant.lines["pumps"].set_knob("pump", "trip", "E05"))
        plant.run(until=8.0)
        plant.broker.stop()
        plant.run(until=30.0)
        return plant.get("/metrics").text


def test_every_metric_of_the_alerts_and_the_dashboard_is_in_a_scrape(whole: str) -> None:
    named = {name.removeprefix(PREFIX) for name in set().union(*map(metrics_in, expressions())) - {"up"}}

    assert len(named) > 30
    assert named - {name for name, _ in samples(whole)} == set()


def test_every_series_that_the_document_names_is_in_a_scrape_and_no_other(whole: str) -> None:
    table = PAGE.read_text("utf-8").split("<!-- metrics:")[1].split("<!-- end of metrics")[0]
    named = {
        match[1]: {*re.findall(r"`(\w+)`", match[2])}
        for match in re.finditer(r"\| `(\w+)` \| \w+ \| (.*?) \|", table)
    }
    scraped: dict[str, set[str]] = {}
    for name, labels in samples(whole):
        of = re.sub(r"_(bucket|sum|count)$", "", name)
        scraped.setdefault(of, set()).update({key for key, _ in labels} - {"le", "quantile"})

    assert set(re.findall(r"# TYPE starter_gateway_(\w+) ", whole)) == named.keys()
    assert scraped == named


def test_promtool_finds_nothing_in_a_scrape_and_no_series_is_there_twice(whole: str) -> None:
    assert promtool("check", "metrics", standard_input=whole.encode()) == ""
    lines = [line.rpartition(" ")[0] for line in whole.splitlines() if not line.startswith("#")]

    assert len(lines) == len(set(lines))


def test_a_histogram_sums_up_its_buckets_and_ends_with_infinity(whole: str) -> None:
    found = samples(whole)
    buckets: dict[tuple[str, frozenset[tuple[str, str]]], list[tuple[float, float]]] = {}
    for (name, labels), value in found.items():
        if name.endswith("_bucket"):
            of = name.removesuffix("_bucket"), frozenset(each for each in labels if each[0] != "le")
            buckets.setdefault(of, []).append((float(dict(labels)["le"]), value))

    assert {name for name, _ in buckets} == {"loop_lag_seconds", "stop_latency_seconds", "command_seconds"}
    for (name, labels), counts in buckets.items():
        assert sorted(counts, key=lambda each: each[1]) == sorted(counts)
        assert max(counts) == (math.inf, found[f"{name}_count", labels])
        assert found[f"{name}_sum", labels] <= found[f"{name}_count", labels] * 30.0


def test_a_bug_in_a_scrape_is_answered_500_and_the_next_one_is_made(monkeypatch: pytest.MonkeyPatch) -> None:
    with RigPlant(SSW07 + WEB + METRICS) as plant:
        plant.run(until=5.0)
        monkeypatch.setattr("gateway.plugins.metrics.collector.Scrape.collect", lambda _: 1 / 0)
        status = plant.get("/metrics").status
        monkeypatch.undo()
        plant.run(until=10.0)

        assert status == 500
        assert "starter_gateway_motor_current_amperes{" in plant.get("/metrics").text
        plant.bugs.found.clear()
