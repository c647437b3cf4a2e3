"""A parameter set as TOML text, a line for each parameter, and back."""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Mapping
from typing import Any

from gateway.errors import UsageError
from gateway.starters.parameters.model import ParameterEntry, ParameterSet

_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")
_ESCAPED = re.compile(r'["\\\x00-\x1f\x7f]')
_FACTS = ("name", "family", "taken", "model", "firmware", "serial")
_ENTRY_KEYS = frozenset({"name", "value", "label", "unit", "raw"})


def to_toml(saved: ParameterSet) -> str:
    """Return the text of a parameter set."""
    facts = (saved.starter, saved.family, saved.taken, saved.model, saved.firmware, saved.serial)
    lines = ["# Parameters of a soft-starter, saved by starter-gateway.", "", "[starter]"]
    lines += [f"{key} = {_toml(fact)}" for key, fact in zip(_FACTS, facts, strict=True) if fact]
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
    starter = _table(document, "starter", path)
    facts = {key: _fact(starter, key, path) for key in _FACTS}
    for key in ("name", "family"):
        if not facts[key]:
            raise UsageError(f"{path}: starter.{key} is missing (is it a file of `parameters save`?)")
    return ParameterSet(
        starter=facts["name"] or "",
        family=facts["family"] or "",
        taken=facts["taken"] or "",
        model=facts["model"],
        firmware=facts["firmware"],
        serial=facts["serial"],
        parameters={
            code.upper(): _entry(code, entry, path)
            for code, entry in _table(document, "parameters", path).items()
        },
        refused={code: str(why) for code, why in _table(document, "refused", path, or_else={}).items()},
    )


def _inline(entry: ParameterEntry) -> str:
    texts = [("name", entry.name), ("unit", entry.unit), ("label", entry.label)]
    shown = [f"{key} = {_toml(text)}" for key, text in texts if text]
    if entry.value is not None:
        shown.insert(1 if entry.name else 0, f"value = {_toml(entry.value)}")
    if entry.raw is not None:
        shown.append(f"raw = [{', '.join(map(str, entry.raw))}]")
    return "{ " + ", ".join(shown) + " }"


def _toml(value: bool | int | float | str) -> str:  # noqa: FBT001 - a value, not an option
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return '"' + _ESCAPED.sub(lambda found: f"\\u{ord(found[0]):04x}", value) + '"'
    return repr(value)


def _key(code: str) -> str:
    return code if _BARE_KEY.fullmatch(code) else _toml(code)


def _table(
    document: Mapping[str, Any], key: str, path: str, *, or_else: dict[str, Any] | None = None
) -> dict[str, Any]:
    table = document.get(key, or_else)
    if not isinstance(table, dict):
        raise UsageError(f"{path}: there is no table [{key}] (is it a file of `parameters save`?)")
    return table


def _fact(table: Mapping[str, Any], key: str, path: str) -> str | None:
    fact = table.get(key)
    if fact is not None and not isinstance(fact, str):
        raise UsageError(f"{path}: starter.{key} must be a text in quotes")
    return fact


def _entry(code: str, content: Any, path: str) -> ParameterEntry:
    where = f"{path}: parameters.{code}"
    entry = content if isinstance(content, dict) else {"value": content}  # P314 = 30, as people write it
    strange = sorted(set(entry) - _ENTRY_KEYS)
    if strange:
        raise UsageError(f"{where}: unknown key {strange[0]} (one of {', '.join(sorted(_ENTRY_KEYS))})")
    value, raw = entry.get("value"), entry.get("raw")
    is_value = value is None or isinstance(value, bool | int | str)
    if not is_value and not (isinstance(value, float) and math.isfinite(value)):
        raise UsageError(f"{where}: value must be a number, a text, true or false")
    if raw is not None and not _are_words(raw):
        raise UsageError(f"{where}: raw must be a list of words, 0..65535")
    if value is None and raw is None:
        raise UsageError(f"{where}: neither value nor raw")
    texts = [str(entry.get(key) or "") for key in ("name", "label", "unit")]
    return ParameterEntry(texts[0], value, texts[1] or None, texts[2], None if raw is None else tuple(raw))


def _are_words(raw: object) -> bool:
    if not isinstance(raw, list) or not raw:
        return False
    return all(type(word) is int and 0 <= word <= 0xFFFF for word in raw)
