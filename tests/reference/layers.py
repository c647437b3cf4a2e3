"""The tables of layers in docs/architecture.md, from the import contracts."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
PURE = "Pure packages import nothing that waits, logs or stores"


def contracts() -> list[Mapping[str, Any]]:
    """Return the import contracts of the project."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
    return list(project["tool"]["importlinter"]["contracts"])


def layers() -> dict[str, list[list[str]]]:
    """Return the layers of each package that has them, the top first; the modules of one layer together."""
    return {
        contract["containers"][0]: [
            [name.strip() for name in layer.split("|")] for layer in contract["layers"]
        ]
        for contract in contracts()
        if contract["type"] == "layers"
    }


def pure() -> list[str]:
    """Return the packages and modules that do no I/O."""
    return next(contract["source_modules"] for contract in contracts() if contract["name"] == PURE)


def tables() -> str:
    """Return the layers as Markdown."""
    inside = layers()
    rows = [f"| {_names(layer)} | {_of(layer, inside)} |" for layer in inside["gateway"]]
    names = ", ".join(f"`{name.removeprefix('gateway.')}`" for name in pure())
    return "\n".join(["| layer, the top first | layers inside |", "|---|---|", *rows, "", f"Pure: {names}."])


def _names(layer: list[str]) -> str:
    return " · ".join(f"`{name}`" for name in layer)


def _of(layer: list[str], inside: Mapping[str, list[list[str]]]) -> str:
    """Return the layers inside the packages of a layer, and inside the packages of those."""
    return "<br>".join(_chain(of, inside) for name in layer for of in inside if _is_in(of, name))


def _is_in(container: str, name: str) -> bool:
    return f"{container}.".startswith(f"gateway.{name}.")


def _chain(container: str, inside: Mapping[str, list[list[str]]]) -> str:
    steps = (" · ".join(each) for each in inside[container])
    return f"{container.rpartition('.')[2]}: {' > '.join(steps)}"
