"""The tests' own house: what stands where."""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

from tests.conftest import GROUPS, GroupScheduling

TESTS = Path(__file__).parent
MODULES = sorted(TESTS.rglob("*.py"))
IN_REAL_TIME = ("end_to_end", "lab", "packages")


def nodes(path: Path) -> Iterator[ast.AST]:
    yield from ast.walk(ast.parse(path.read_text("utf-8")))


def is_test(name: str) -> bool:
    return name.rpartition(".")[2].startswith("test_")


def imported(path: Path) -> Iterator[str]:
    """Yield what a module imports, with each name that may be a module."""
    for node in nodes(path):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield str(node.module)
            if str(node.module).startswith("tests") and node.module != "tests":
                yield from (f"{node.module}.{a.name}" for a in node.names if is_module(node.module, a.name))


def is_module(package: str | None, name: str) -> bool:
    return (TESTS.parent / str(package).replace(".", "/") / f"{name}.py").exists()


def test_each_group_of_tests_is_one_piece_of_work_and_every_other_test_one_of_its_own() -> None:
    names = {
        f"tests/{path.relative_to(TESTS)}::{node.name}[deb1{minor}]"
        for path in MODULES
        if is_test(path.stem)
        for node in ast.parse(path.read_text("utf-8")).body
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and is_test(node.name)
        for minor in (2, 3)
    }
    found = defaultdict(set)
    for name in names:
        found[GroupScheduling._split_scope(SimpleNamespace(), name)].add(name.split("::")[0])  # type: ignore[arg-type]

    assert {name for name, files in found.items() if name not in names} == GROUPS.keys()
    assert found["broker kit"] == {"tests/end_to_end/deploy/test_broker_kit.py"}
    assert found["deb12"] == found["deb13"]
    assert len(found["demo"]) == 2


def test_no_test_module_is_imported() -> None:
    found = [
        f"{path.relative_to(TESTS)} imports {name}"
        for path in MODULES
        for name in imported(path)
        if name.startswith("tests.") and is_test(name)
    ]

    assert found == [], "helpers stand in modules of their own"


def test_only_tests_in_real_time_have_a_broker_or_sleep() -> None:
    found = [
        f"{path.relative_to(TESTS)}: {ast.unparse(node)}"
        for path in MODULES
        if is_test(path.stem) and path.relative_to(TESTS).parts[0] not in IN_REAL_TIME
        for node in nodes(path)
        if (isinstance(node, ast.Call) and ast.unparse(node.func) == "time.sleep")
        or (isinstance(node, ast.Name) and node.id in ("MosquittoBroker", "StartMosquitto"))
    ]

    assert found == [], "they belong into tests/end_to_end"
