"""docs/sparkplug-conformance.md says of each assertion what proves it; the tests that it names exist."""

from __future__ import annotations

import ast
import csv
import re
from pathlib import Path

HERE = Path(__file__).parent
PAGE = HERE.parents[1] / "docs" / "sparkplug-conformance.md"
ROW = re.compile(r"\| `(tck-id-[\w-]+)` \| (yes|by design|n/a) \| (.+) \|")
TEST = re.compile(r"`tests/sparkplug/(test_\w+\.py)` `(test_\w+)`")


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

    named = {tuple(TEST.findall(by)[0]) for _, verdict, by in rows() if verdict == "yes"}
    assert named
    assert named <= found


def test_templates_and_data_sets_alone_do_not_apply() -> None:
    left_out = [each for each, verdict, _ in rows() if verdict == "n/a"]

    assert all("template" in each or "dataset" in each for each in left_out)
