"""Mistakes in a configuration: one `Mistake`, the wording of what the models refuse, and where rules look.

A mistake has its key, what is wrong and a hint; `load` adds the line in the file. Rules across tables look
into the document as parsed: a value of the wrong type counts as none there, since the models find that.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from datetime import date, time
from typing import Any, get_args

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from gateway.config.schema import REPEATED_TABLES, Config
from gateway.config.toml_lines import Key
from gateway.config.values import (
    BASE_PATH_PATTERN,
    FIRMWARE_PATTERN,
    HOST_PATTERN,
    NAME_PATTERN,
    PROM_FILE_PATTERN,
    USER_PATTERN,
)
from gateway.system.password_hash import LINE_PATTERN
from gateway.system.value_demands import demand_of


@dataclass(frozen=True, slots=True)
class Mistake:
    """What is wrong with one key, and how to correct it."""

    key: Key
    what: str
    hint: str = ""


def spell(key: Key) -> str:
    """Return a path as people write it: line[0].starter[2].address."""
    text = ""
    for part in key:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text


def choose(wrong: object, known: Iterable[str]) -> str:
    """Return the hint for an unknown word: the nearest known one, or all of them."""
    words = list(dict.fromkeys(known))
    spelt = {word.lower(): word for word in words}
    near = difflib.get_close_matches(str(wrong).lower(), spelt, n=2)
    near = near[:1] if near and near[0] == str(wrong).lower() else near
    near = [spelt[each] for each in near]
    return f"did you mean {' or '.join(near)}?" if near else "one of " + ", ".join(words)


def short(value: object) -> str:
    """Return a foreign value for a message: quoted, and cut when it is long."""
    if isinstance(value, bool):
        return str(value).lower()
    text = str(value) if isinstance(value, (date, time)) else repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def explain(error: ValidationError) -> list[Mistake]:
    """Return every mistake that the models found in a document."""
    mistakes = []
    for detail in error.errors(include_url=False):
        if detail["type"] == "too_short" and detail["input"]:
            continue  # its items are wrong, and named one by one
        mistakes.append(_mistake(detail))
    return mistakes


def _mistake(detail: ErrorDetails) -> Mistake:
    key: Key = detail["loc"]
    kind = detail["type"]
    ctx = detail.get("ctx", {})
    explanation = _EXPLANATIONS.get(kind)
    if explanation is None:
        return Mistake(key, f"is {short(detail['input'])}", demand_of(kind, ctx))
    return Mistake(key, *explanation(key, detail["input"], ctx))


_MISSING_HINTS = {
    "web.user.operator": "name the client of an [[operator]]: the login has its rights",
    "web.user.password": "paste the line that starter-gateway web-password prints",
}


def _missing(key: Key, _value: Any, _ctx: Mapping[str, Any]) -> tuple[str, str]:
    hint = _MISSING_HINTS.get(_header(key))
    if hint is not None:
        return "is missing", hint
    if _header(key) in REPEATED_TABLES:
        return "is missing", f"at least one [[{_header(key)}]] is needed"
    if len(key) == 1:
        return "is missing", f"a table [{key[0]}] is needed"
    return "is missing", ""


def _unknown(key: Key, _value: Any, _ctx: Mapping[str, Any]) -> tuple[str, str]:
    return "unknown key", choose(key[-1], _known_keys(key[:-1]))


_PATTERN_HINTS = {
    FIRMWARE_PATTERN: "two numbers with a point between them, such as 1.30",
    USER_PATTERN: "only letters, digits, _ . @ and -",
    HOST_PATTERN: "a name or address without port, such as mcc1.plant",
    BASE_PATH_PATTERN: "a path such as /mcc1",
    PROM_FILE_PATTERN: "a file whose name ends in .prom: node-exporter reads no others",
}


def _pattern(_key: Key, value: Any, ctx: Mapping[str, Any]) -> tuple[str, str]:
    if ctx["pattern"] == LINE_PATTERN:  # perhaps a password: it is not shown
        return "is no password line", "paste the line that starter-gateway web-password prints"
    if ctx["pattern"] in _PATTERN_HINTS:
        return f"is {short(value)}", _PATTERN_HINTS[ctx["pattern"]]
    also = "" if ctx["pattern"] == NAME_PATTERN else ", and * or ? for any others"
    return f"is {short(value)}", f"only a-z, 0-9, _ and -{also}"


def _choice(_key: Key, value: Any, ctx: Mapping[str, Any]) -> tuple[str, str]:
    words = re.findall(r"'([^']*)'", ctx["expected"])
    if words and isinstance(value, str):
        return f"is {short(value)}", choose(value, words)
    return f"is {short(value)}", f"must be {ctx['expected']}"


def _empty(key: Key, _value: Any, _ctx: Mapping[str, Any]) -> tuple[str, str]:
    if _header(key) in REPEATED_TABLES:
        return "is empty", f"at least one [[{_header(key)}]] is needed"
    return "is empty", "name at least one"


def _no_list(key: Key, value: Any, _ctx: Mapping[str, Any]) -> tuple[str, str]:
    if _header(key) in REPEATED_TABLES:
        return "is not a list of tables", f"write [[{_header(key)}]], with two brackets"
    return f"is {short(value)}", 'must be a list, e.g. ["start", "stop"]'


def _no_table(key: Key, value: Any, _ctx: Mapping[str, Any]) -> tuple[str, str]:
    return f"is {short(value)}", f"must be a table, [{_header(key)}]"


def _length(_key: Key, value: Any, ctx: Mapping[str, Any]) -> tuple[str, str]:
    if not value:
        return "is empty", "leave the key out, or give it a value"
    return f"has {len(value)} characters", f"at most {ctx['max_length']}"


_EXPLANATIONS: dict[str, Callable[[Key, Any, Mapping[str, Any]], tuple[str, str]]] = {
    "missing": _missing,
    "extra_forbidden": _unknown,
    "string_pattern_mismatch": _pattern,
    "string_too_short": _length,
    "string_too_long": _length,
    "literal_error": _choice,
    "too_short": _empty,
    "tuple_type": _no_list,
    "model_type": _no_table,
}


def _header(key: Key) -> str:
    return ".".join(str(part) for part in key if not isinstance(part, int))


def _known_keys(table: Key) -> list[str]:
    model: type[BaseModel] = Config
    for part in table:
        if isinstance(part, str):
            field = next(f for name, f in model.model_fields.items() if (f.alias or name) == part)
            model = next(t for t in (field.annotation, *get_args(field.annotation)) if _is_model(t))
    return [field.alias or name for name, field in model.model_fields.items()]


def _is_model(annotation: Any) -> bool:
    return isinstance(annotation, type) and issubclass(annotation, BaseModel)


Document = Mapping[str, Any]


def lines_in(document: Document) -> Iterator[tuple[Key, Document]]:
    """Yield the lines with their keys."""
    for index, line in enumerate(list_in(document, "line")):
        if isinstance(line, Mapping):
            yield ("line", index), line


def starters_in(document: Document) -> Iterator[tuple[Key, Document]]:
    """Yield the starters of all lines with their keys."""
    for key, line in lines_in(document):
        yield from starters_of(key, line)


def starters_of(key: Key, line: Document) -> Iterator[tuple[Key, Document]]:
    """Yield a line's starters with their keys."""
    for index, starter in enumerate(list_in(line, "starter")):
        if isinstance(starter, Mapping):
            yield (*key, "starter", index), starter


def table_in(document: Document, name: str) -> Document:
    """Return a table; an empty one for none."""
    table = document.get(name)
    return table if isinstance(table, Mapping) else {}


def list_in(document: Document, name: str) -> list[Any]:
    """Return a list; an empty one for none."""
    items = document.get(name)
    return items if isinstance(items, list) else []


def text_in(table: Document, name: str) -> str:
    """Return a text; an empty one for none."""
    text = table.get(name)
    return text if isinstance(text, str) else ""


def again(seen: dict[object, Key], key: Key, value: object, hint: str) -> Iterator[Mistake]:
    """Yield a value that another key has too; `seen` is what came before."""
    if not value or not isinstance(value, str | int):
        return
    if value in seen:
        yield Mistake(key, f"{short(value)} is also {spell(seen[value])}", hint)
    seen.setdefault(value, key)
