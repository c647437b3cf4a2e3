"""docs/sparkplug-conformance.md has the proof of each assertion; the tests that it names exist."""

from __future__ import annotations

import ast
import csv
import re
from pathlib import Path

HERE = Path(__file__).parent
SCENARIOS = HERE.parent / "scenarios" / "plugins" / "test_sparkplug.py"
PAGE = HERE.parents[1] / "docs" / "sparkplug-conformance.md"
ROW = re.compile(r"^\| (.+) \| (`tck-id-.+`) \|$", re.MULTILINE)
TEST = re.compile(r"`tests/sparkplug/(test_\w+\.py)` `(test_\w+)`")
SCENARIO = re.compile(r"`tests/scenarios/plugins/test_sparkplug.py`: (.+)")


def rows() -> list[tuple[str, str, str]]:
    """Return the assertions, each with its section of the page and its proof."""
    return [
        (assertion, section.partition("\n")[0], proof)
        for section in PAGE.read_text("utf-8").split("\n## ")
        for proof, assertions in ROW.findall(section)
        for assertion in re.findall(r"`(.+?)`", assertions)
    ]


def test_every_assertion_is_there_exactly_once() -> None:
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

    scenarios = set(re.findall(r'(?:row|scene)\(\s+"(.+)",', SCENARIOS.read_text("utf-8")))
    proofs = [by for _, section, by in rows() if section == "Proved by a test"]
    by_scenario = {match[1] for by in proofs if (match := SCENARIO.fullmatch(by))}
    by_test = {tuple(TEST.findall(by)[0]) for by in proofs if not SCENARIO.fullmatch(by)}
    assert by_test
    assert by_test <= found
    assert by_scenario <= scenarios


def test_templates_and_data_sets_alone_do_not_apply() -> None:
    left_out = [each for each, section, _ in rows() if section == "Does not apply"]

    assert len(left_out) == 34
    assert all("template" in each or "dataset" in each for each in left_out)
