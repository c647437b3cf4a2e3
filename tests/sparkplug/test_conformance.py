"""docs/sparkplug-conformance.md says of each assertion what proves it; the tests that it names exist."""

from __future__ import annotations

import ast
import csv
import re
from pathlib import Path

HERE = Path(__file__).parent
SCENARIOS = HERE.parent / "scenarios" / "plugins" / "test_sparkplug.py"
PAGE = HERE.parents[1] / "docs" / "sparkplug-conformance.md"
ROW = re.compile(r"\| `(tck-id-[\w-]+)` \| (yes|by design|n/a) \| (.+) \|")
TEST = re.compile(r"`tests/sparkplug/(test_\w+\.py)` `(test_\w+)`")
SCENARIO = re.compile(r"`tests/scenarios/plugins/test_sparkplug.py`: (.+)")


def rows() -> list[tuple[str, str, str]]:
    return ROW.findall(PAGE.read_text("utf-8"))


def test_every_assertion_has_exactly_one_row() -> None:
    with (HERE / "assertions.csv").open(encoding="utf-8") as file:
        ids = [row["id"] for row in csv.DictReader(file)]

    assert len(set(ids)) == 200
    assert sorted(each for each, _, _ in rows()) == sorted(ids)


def test_every_test_that_proves_an_assertion_exists() -> None:
    found = {
        (path.name, node.name)
        for path in HERE.glob("test_*.py")
        for node in ast.walk(ast.parse(path.read_text("utf-8")))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
    }

    scenarios = set(re.findall(r'row\(\s+"(.+)",', SCENARIOS.read_text("utf-8")))
    proofs = [by for _, verdict, by in rows() if verdict == "yes"]
    by_scenario = {match[1] for by in proofs if (match := SCENARIO.fullmatch(by))}
    by_test = {tuple(TEST.findall(by)[0]) for by in proofs if not SCENARIO.fullmatch(by)}
    assert by_test
    assert by_test <= found
    assert by_scenario <= scenarios


def test_templates_and_data_sets_alone_do_not_apply() -> None:
    left_out = [each for each, verdict, _ in rows() if verdict == "n/a"]

    assert all("template" in each or "dataset" in each for each in left_out)
