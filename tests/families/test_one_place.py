"""A family stands in one folder of data and one file: the rest names no family and no row of one."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from gateway.families.devices import DEVICES
from gateway.families.devices.device import Device
from gateway.families.profile.load import FAMILIES, load_profile

GATEWAY = Path(__file__).parents[2] / "gateway"
# The simulator has starters of its own; the demonstration is a site, as a user writes one.
OWN = ("families/devices", "sim", "cli/demo")
CODE = r"P[0-9]{3}|VB[0-9]{2}|[SCD][0-9]+\.[0-9][0-9.]*|COIL[0-9]+|R[0-9]{1,2}"
NAMED = re.compile(rf"\b(?:{CODE}|{'|'.join(FAMILIES)})\b")
EXAMPLE = re.compile(r"e\.g\.|such as")


def texts_in(tree: ast.Module) -> list[tuple[int, str]]:
    """Return the texts that the code uses: a docstring may cite a manual, and a hint give an example."""
    prose: set[int] = set()
    texts: list[tuple[int, str]] = []
    for node in ast.walk(tree):
        is_help = isinstance(node, ast.keyword) and node.arg == "help"
        is_examples = isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "EXAMPLES"
        if isinstance(node, ast.Expr) or is_help or is_examples:
            prose.update(map(id, ast.walk(node.value)))  # type: ignore[attr-defined]
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in prose:
            texts += [] if EXAMPLE.search(node.value) else [(node.lineno, node.value)]
    return texts


def test_no_generic_module_names_a_family_or_a_row_of_one() -> None:
    named = [
        f"{path.relative_to(GATEWAY)}:{line}: {text[:60]!r}"
        for path in sorted(GATEWAY.rglob("*.py"))
        if not path.relative_to(GATEWAY).as_posix().startswith(OWN)
        for line, text in texts_in(ast.parse(path.read_text("utf-8")))
        if NAMED.search(text)
    ]

    assert named == []


@pytest.mark.parametrize("family", FAMILIES)
def test_a_device_looks_only_at_rows_of_its_profile(family: str) -> None:
    device, profile = DEVICES[family], load_profile(family)
    rows = {
        *device.start_rows,
        *device.source_rows,
        *device.watchdog_rows,
        *device.slot_rows,
        *device.counter_rows,
    }

    assert rows <= set(profile.parameters)
    assert set(device.source_rows) <= set(profile.protected.command_sources)


@pytest.mark.parametrize("family", FAMILIES)
def test_the_verb_configure_is_a_procedure_of_the_device_or_not_there(family: str) -> None:
    has_procedure = type(DEVICES[family]).build_configure is not Device.build_configure

    assert ("configure" in load_profile(family).commands) == has_procedure
