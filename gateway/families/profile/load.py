"""Loads the families' profiles: `family.toml` and the tables beside it.

A profile is a directory `profiles/<family>` with `family.toml` (identity, timing, limits, points, commands),
`parameters.csv` (a `Parameter` a line) and, where the family needs them, `enums.csv`, `bits.csv`,
`alarms.csv`, `ranges.csv` (limits that differ by model) and `presets.csv` (factory settings, off,
full scale). A new family is a new directory. An empty cell means that the manual does not say.

The shape of each part is checked here; that the parts fit together: `tests/families/test_consistency.py`.
"""

from __future__ import annotations

import csv
import functools
import tomllib
from importlib import resources
from importlib.resources.abc import Traversable
from typing import Any

from gateway.errors import UsageError
from gateway.families.profile.names import translated
from gateway.families.profile.schema import Profile

_PROFILES = resources.files("gateway.families") / "profiles"

FAMILIES = tuple(sorted(each.name for each in _PROFILES.iterdir() if (each / "family.toml").is_file()))
ENGLISH = "en"
LANGUAGES = (ENGLISH, "es", "pt")  # of the names; a family has those that a manual of it is written in


def load_profile(family: str, language: str = ENGLISH) -> Profile:
    """Return a shipped profile by its family's name, one of `FAMILIES`; UsageError for any other name.

    A row without a name in one of `LANGUAGES` is named in English.
    """
    if family not in FAMILIES:
        raise UsageError(f"no family {family!r}; there are {', '.join(FAMILIES)}")
    if language not in LANGUAGES:
        raise UsageError(f"no language {language!r}; there are {', '.join(LANGUAGES)}")
    return _shipped(family, language)


@functools.cache
def _shipped(family: str, language: str) -> Profile:
    return read_profile(_PROFILES / family, language)


def read_profile(directory: Traversable, language: str = ENGLISH) -> Profile:
    """Return the profile in `directory`; ValueError with every part that has not the shape of its model."""
    content = tomllib.loads((directory / "family.toml").read_text(encoding="utf-8"))
    presets = {row["code"]: row for row in rows_of(directory / "presets.csv")}
    ranges = rows_of(directory / "ranges.csv")
    content["parameters"] = {
        row["code"]: {
            "decimals": None,
            **row,
            **presets.get(row["code"], {}),
            "ranges": [each for each in ranges if each["code"] == row["code"]],
        }
        for row in rows_of(directory / "parameters.csv")
    }
    content["enums"] = _labels(directory / "enums.csv", number="value")
    content["bits"] = _labels(directory / "bits.csv", number="bit")
    content["alarms"] = rows_of(directory / "alarms.csv")
    return translated(Profile.model_validate(content), rows_of(directory / f"{language}.csv"))


def rows_of(path: Traversable) -> list[dict[str, Any]]:
    """Return the lines of a table without its empty cells; none where there is no table."""
    lines = path.read_text(encoding="utf-8").splitlines() if path.is_file() else []
    return [{key: cell for key, cell in cells.items() if cell} for cells in csv.DictReader(lines)]


def _labels(path: Traversable, *, number: str) -> dict[str, dict[str, str]]:
    """Return the labels by code and number, from the columns `code`, `number` and `label`."""
    found: dict[str, dict[str, str]] = {}
    for row in rows_of(path):
        found.setdefault(row["code"], {})[row[number]] = row["label"]
    return found
