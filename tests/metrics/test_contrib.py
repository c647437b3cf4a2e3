"""The alerts and the dashboard that users copy: judged by promtool and a PromQL parser."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from gateway.plugins.metrics.catalogue import PREFIX, SPECS
from tests.metrics.contrib import (
    PROMETHEUS,
    RULES,
    dashboard,
    expressions,
    label_names_in,
    metrics_in,
    rules,
)
from tests.metrics.promtool import promtool

PAGE = Path(__file__).parents[2] / "docs" / "metrics.md"
ADDED = {"le", "quantile", "instance", "job"}  # by the metric's type, and by Prometheus


def test_promtool_takes_the_rules_and_the_example_of_a_configuration() -> None:
    assert f"{len(rules())} rules found" in promtool("check", "rules", RULES.name, folder=PROMETHEUS)
    assert "is valid" in promtool("check", "config", "prometheus.yml", folder=PROMETHEUS)


def test_each_alert_comes_when_it_should_and_not_before() -> None:
    assert "SUCCESS" in promtool("test", "rules", "starter-gateway.test.yml", folder=PROMETHEUS)


def test_every_alert_is_tried() -> None:
    tried = (PROMETHEUS / "starter-gateway.test.yml").read_text("utf-8")

    assert [rule["alert"] for rule in rules() if f"alertname: {rule['alert']}\n" not in tried] == []


@pytest.mark.parametrize("rule", rules(), ids=lambda rule: rule["alert"])
def test_an_alert_says_how_grave_it_is_what_it_is_and_where_that_is_explained(
    rule: dict[str, dict[str, str]],
) -> None:
    alert = str(rule["alert"])

    assert re.fullmatch(r"([A-Z][a-z]+)+", alert)
    assert rule["labels"]["severity"] in ("critical", "warning", "info")
    assert rule["annotations"].keys() == {"summary", "description", "runbook_url"}
    assert rule["annotations"]["runbook_url"] == f"http://docs.example/metrics.html#{alert.lower()}"
    assert f"### {alert}\n" in PAGE.read_text("utf-8")


@pytest.mark.parametrize("expression", expressions())
def test_every_expression_can_be_parsed_and_names_metrics_and_labels_that_exist(expression: str) -> None:
    for metric in metrics_in(expression) - {"up"}:
        assert metric.startswith(PREFIX)
    for metric, label in label_names_in(expression) - {("up", "job")}:
        name = re.sub("_(bucket|sum|count)$", "", metric.removeprefix(PREFIX))
        assert label in {*SPECS[name].labels, *ADDED}, f"{metric} has no {label}"


def test_the_dashboard_can_be_provisioned() -> None:
    board = dashboard()

    assert "__inputs" not in board, "it breaks provisioning"
    assert board["uid"] == "starter-gateway"
    assert "id" not in board
    panels = board["panels"]
    assert len({panel["id"] for panel in panels}) == len(panels)
    (source,) = (each for each in board["templating"]["list"] if each["type"] == "datasource")
    assert (source["name"], source["query"]) == ("datasource", "prometheus")


def test_every_panel_reads_the_chosen_data_source() -> None:
    panels = [panel for panel in dashboard()["panels"] if panel["type"] != "row"]

    for panel in panels:
        for each in (panel, *panel["targets"]):
            assert each["datasource"] == {"type": "prometheus", "uid": "${datasource}"}, panel["title"]


def test_every_variable_is_used_and_every_used_one_exists() -> None:
    board = dashboard()
    names = {each["name"] for each in board["templating"]["list"]}
    text = str(board["panels"]) + str(board["templating"])

    assert set(re.findall(r"\$\{?([a-z]+)\b", text)) == names
