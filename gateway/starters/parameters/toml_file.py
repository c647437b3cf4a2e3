"""A parameter set as TOML text, a line for each parameter, and back."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Mapping
from typing import Any

from pydantic import TypeAdapter, ValidationError

from gateway.errors import UsageError
from gateway.starters.parameters.model import ParameterEntry, ParameterSet

_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")
_FACTS = ("name", "family", "taken", "model", "firmware", "serial")  # the table [starter]
_SET, _ENTRY = TypeAdapter(ParameterSet), TypeAdapter(ParameterEntry)


def to_toml(saved: ParameterSet) -> str:
    """Return the text of a parameter set."""
    lines = ["# Parameters of a soft-starter, saved by starter-gateway.", "", "[starter]"]
    lines += [f"{key} = {_toml(fact)}" for key in _FACTS if (fact := getattr(saved, key))]
    lines += ["", "[parameters]"]
    lines += [f"{_key(code)} = {_inline(entry)}" for code, entry in saved.parameters.items()]
    if saved.refused:
        lines += ["", "[refused] # could not be read"]
        lines += [f"{_key(code)} = {_toml(reason)}" for code, reason in saved.refused.items()]
    return "\n".join(lines) + "\n"


def from_toml(text: str, path: str) -> ParameterSet:
    """Return the parameter set in a text; UsageError, with `path` and the place, when it holds none."""
    try:
        document = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise UsageError(f"{path}: {error}") from error
    starter, parameters = (_table(document, name, path) for name in ("starter", "parameters"))
    entries = {  # people write P314 = 30
        code.upper(): entry if isinstance(entry, dict) else {"value": entry}
        for code, entry in parameters.items()
    }
    found = {**starter, "parameters": entries, "refused": document.get("refused", {})}
    try:
        return _SET.validate_json(json.dumps(found, default=str))  # as JSON: its lists are tuples
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"]))
        where = place if place.startswith(("parameters", "refused")) else f"starter.{place}"
        raise UsageError(f"{path}: {where}: {first['msg']}: {first['input']!r:.60}") from error


def _inline(entry: ParameterEntry) -> str:
    said = _ENTRY.dump_python(entry, exclude_defaults=True)
    return "{ " + ", ".join(f"{key} = {_toml(value)}" for key, value in said.items()) + " }"


def _toml(value: object) -> str:
    """Return a value, or a list of numbers, as TOML: it is written as in JSON, but for the character 7Fh."""
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def _key(code: str) -> str:
    return code if _BARE_KEY.fullmatch(code) else _toml(code)


def _table(document: Mapping[str, Any], key: str, path: str) -> dict[str, Any]:
    table = document.get(key)
    if not isinstance(table, dict):
        raise UsageError(f"{path}: there is no table [{key}] (is it a file of `parameters save`?)")
    return table
