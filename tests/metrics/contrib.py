"""What deploy/contrib holds for Prometheus and Grafana: its expressions, and the metrics that they name."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import promql_parser
import yaml

CONTRIB = Path(__file__).parents[2] / "deploy" / "contrib"
PROMETHEUS = CONTRIB / "prometheus"
RULES = PROMETHEUS / "starter-gateway.rules.yml"
DASHBOARD = CONTRIB / "grafana" / "starter-gateway.json"
RATE_INTERVAL = "$__rate_interval"  # the one variable of Grafana's own that is used


def rules() -> list[dict[str, Any]]:
    """Return the alert rules."""
    return [rule for group in yaml.safe_load(RULES.read_text("utf-8"))["groups"] for rule in group["rules"]]


def dashboard() -> dict[str, Any]:
    """Return the dashboard."""
    return dict(json.loads(DASHBOARD.read_text("utf-8")))


def panel_expressions() -> list[str]:
    """Return the expressions of the panels, with a length in the place of Grafana's interval."""
    targets = [target for panel in dashboard()["panels"] for target in panel.get("targets", ())]
    return [target["expr"].replace(RATE_INTERVAL, "1m") for target in targets]


def variable_selectors() -> list[str]:
    """Return what the dashboard's variables take their values from."""
    variables = [each for each in dashboard()["templating"]["list"] if each["type"] == "query"]
    return [each["definition"].removeprefix("label_values(").rpartition(",")[0] for each in variables]


def expressions() -> list[str]:
    """Return every expression that is not ours to be wrong about."""
    return [*(rule["expr"] for rule in rules()), *panel_expressions(), *variable_selectors()]


def metrics_in(expression: str) -> set[str]:
    """Return the names of the metrics in an expression; ValueError when it is none."""
    return {found.name for found in _selectors(promql_parser.parse(expression)) if found.name}


def label_names_in(expression: str) -> set[tuple[str, str]]:
    """Return (metric, label) for each label that an expression selects by."""
    return {
        (found.name, matcher.name)
        for found in _selectors(promql_parser.parse(expression))
        for matcher in found.matchers.matchers
    }


def _selectors(node: Any) -> Iterator[Any]:
    if isinstance(node, promql_parser.VectorSelector):
        yield node
    elif isinstance(node, promql_parser.MatrixSelector):
        yield node.vector_selector
    else:
        for name in ("expr", "lhs", "rhs", "param"):
            inner = getattr(node, name, None)
            if inner is not None and not isinstance(inner, (str, float)):
                yield from _selectors(inner)
        for each in getattr(node, "args", None) or ():
            yield from _selectors(each)
