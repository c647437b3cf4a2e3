"""Loads the families' profiles: `family.toml` and the tables beside it, every mistake reported at once.

A profile is a directory `profiles/<family>` with `family.toml` (identity, timing, limits, points, commands),
`parameters.csv` (a `Parameter` a line) and, where the family needs them, `enums.csv`, `bits.csv`,
`alarms.csv`, `ranges.csv` (limits that differ by model) and `presets.csv` (factory settings, off,
full scale). A new family is a new directory. An empty cell means that the manual does not say.
"""

from __future__ import annotations

import csv
import functools
import tomllib
from collections.abc import Iterator
from importlib import resources
from importlib.resources.abc import Traversable
from typing import Any, TypeVar

from pydantic import AliasChoices, BaseModel, ConfigDict, Field, ValidationError

from gateway.errors import ProfileError, UsageError
from gateway.families.profile.consistency import contradictions
from gateway.families.profile.names import Translation, translated
from gateway.families.profile.rows import Alarm, ModelRange, Parameter, Preset
from gateway.families.profile.schema import Profile
from gateway.system.value_demands import demand_of

_PROFILES = resources.files("gateway.families") / "profiles"

FAMILIES = tuple(sorted(each.name for each in _PROFILES.iterdir() if (each / "family.toml").is_file()))
ENGLISH = "en"
LANGUAGES = (ENGLISH, "es", "pt")  # of the names; a family has those that a manual of it is written in

_Row = TypeVar("_Row", bound=BaseModel)


class _Label(BaseModel):
    """A line of `enums.csv` or `bits.csv`."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    code: str
    number: int = Field(validation_alias=AliasChoices("value", "bit"))
    label: str


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


def languages_of(family: str) -> tuple[str, ...]:
    """Return the languages in which a shipped family has names, English first."""
    return tuple(
        each for each in LANGUAGES if each == ENGLISH or (_PROFILES / family / f"{each}.csv").is_file()
    )


def read_profile(directory: Traversable, language: str = ENGLISH) -> Profile:
    """Return the profile in `directory`; ProfileError with all its mistakes."""
    problems: list[str] = []
    content = _read_toml(directory / "family.toml", problems)
    content["parameters"] = _read_parameters(directory, problems)
    content["enums"] = _read_labels(directory / "enums.csv", problems)
    content["bits"] = _read_labels(directory / "bits.csv", problems)
    content["alarms"] = [row for _, row in _read_rows(directory / "alarms.csv", Alarm, problems)]
    profile: Profile | None = None
    try:
        profile = Profile.model_validate(content)
    except ValidationError as error:
        problems += _explain("family.toml", error)
    if profile is not None:
        problems += contradictions(profile)
        rows = _read_rows(directory / f"{language}.csv", Translation, problems)
        profile = translated(profile, rows, problems)
    if profile is None or problems:
        raise ProfileError(directory.name, problems)
    return profile


def _read_toml(path: Traversable, problems: list[str]) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, tomllib.TOMLDecodeError) as error:
        problems.append(f"{path.name}: {error}")
        return {}


def _read_lines(path: Traversable) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield each line of a table with the place it stands at; empty cells are left out."""
    if not path.is_file():
        return
    reader = csv.DictReader(path.read_text(encoding="utf-8").splitlines(), restkey="more")
    for cells in reader:
        yield f"{path.name}:{reader.line_num}", {key: cell for key, cell in cells.items() if cell}


def _read_rows(path: Traversable, shape: type[_Row], problems: list[str]) -> Iterator[tuple[str, _Row]]:
    for where, cells in _read_lines(path):
        try:
            yield where, shape.model_validate(cells)
        except ValidationError as error:
            problems.extend(_explain(where, error))


def _read_labels(path: Traversable, problems: list[str]) -> dict[str, dict[int, str]]:
    found: dict[str, dict[int, str]] = {}
    for where, row in _read_rows(path, _Label, problems):
        labels = found.setdefault(row.code, {})
        if row.number in labels:
            problems.append(f"{where}: {row.code} has {row.number} twice")
        labels[row.number] = row.label
    return found


def _read_parameters(directory: Traversable, problems: list[str]) -> dict[str, Parameter]:
    ranges: dict[str, list[ModelRange]] = {}
    for _, each in _read_rows(directory / "ranges.csv", ModelRange, problems):
        ranges.setdefault(each.code, []).append(each)
    presets = {
        row.code: row.model_dump(exclude_none=True)
        for _, row in _read_rows(directory / "presets.csv", Preset, problems)
    }
    rows: dict[str, Parameter] = {}
    for where, cells in _read_lines(directory / "parameters.csv"):
        cells.setdefault("decimals", None)
        try:
            code = cells.get("code", "")
            preset = presets.pop(code, {})
            row = Parameter.model_validate({**cells, **preset, "ranges": ranges.pop(code, ())})
        except ValidationError as error:
            problems += _explain(where, error)
            continue
        if row.code in rows:
            problems.append(f"{where}: {row.code} stands twice")
        rows[row.code] = row
    problems += [f"ranges.csv: {code} is no parameter" for code in ranges]
    problems += [f"presets.csv: {code} is no parameter" for code in presets]
    return rows


def _explain(where: str, error: ValidationError) -> list[str]:
    return [
        f"{where}: {'.'.join(map(str, detail['loc']))}: {demand_of(detail)}"
        for detail in error.errors(include_url=False)
    ]
