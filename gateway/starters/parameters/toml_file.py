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
_ESCAPED = re.compile(r'["\\\x00-\x1f\x7f]')
_FACTS = {"name": "starter"} | {key: key for key in ("family", "taken", "model", "firmware", "serial")}
_SET = TypeAdapter(ParameterSet)


def to_toml(saved: ParameterSet) -> str:
    """Return the text of a parameter set."""
    facts = {key: getattr(saved, field) for key, field in _FACTS.items()}
    lines = ["# Parameters of a soft-starter, saved by starter-gateway.", "", "[starter]"]
    lines += [f"{key} = {_toml(fact)}" for key, fact in facts.items() if fact]
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
    found = {_FACTS.get(key, f"starter.{key}"): value for key, value in starter.items()}
    found["parameters"] = {  # people write P314 = 30
        code.upper(): entry if isinstance(entry, dict) else {"value": entry}
        for code, entry in parameters.items()
    }
    found["refused"] = document.get("refused", {})
    try:
        read = _SET.validate_json(json.dumps(found, default=str))  # as JSON: its lists are tuples
    except ValidationError as error:
        first = error.errors()[0]
        place, *steps = map(str, first["loc"])
        keys = {field: f"starter.{key}" for key, field in _FACTS.items()}
        where = ".".join((keys.get(place, place), *steps))
        raise UsageError(f"{path}: {where}: {first['msg']}: {first['input']!r:.60}") from error
    empty = [code for code, entry in read.parameters.items() if entry.value is None and entry.raw is None]
    if empty:
        raise UsageError(f"{path}: parameters.{empty[0]}: neither value nor raw")
    return read


def _inline(entry: ParameterEntry) -> str:
    shown = {
        "name": entry.name or None,
        "value": entry.value,
        "unit": entry.unit or None,
        "label": entry.label or None,
    }
    texts = [f"{key} = {_toml(value)}" for key, value in shown.items() if value is not None]
    if entry.raw is not None:
        texts.append(f"raw = [{', '.join(map(str, entry.raw))}]")
    return "{ " + ", ".join(texts) + " }"


def _toml(value: bool | int | float | str) -> str:  # noqa: FBT001 - a value, not an option
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return '"' + _ESCAPED.sub(lambda found: f"\\u{ord(found[0]):04x}", value) + '"'
    return repr(value)


def _key(code: str) -> str:
    return code if _BARE_KEY.fullmatch(code) else _toml(code)


def _table(document: Mapping[str, Any], key: str, path: str) -> dict[str, Any]:
    table = document.get(key)
    if not isinstance(table, dict):
        raise UsageError(f"{path}: there is no table [{key}] (is it a file of `parameters save`?)")
    return table
