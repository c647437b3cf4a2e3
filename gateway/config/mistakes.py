"""Mistakes in a configuration: one `Mistake`, the wording of what the models refuse, and where rules look.

A mistake has its key, what is wrong and a hint; `load` adds the line in the file. Rules look at the tables
that are right by themselves, so that a mistake in one table hides none in others.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, get_args

from pydantic import BaseModel, ValidationError

from gateway.config.schema import REPEATED_TABLES, Config
from gateway.config.toml_lines import Key
from gateway.config.values import (
    BASE_PATH_PATTERN,
    FIRMWARE_PATTERN,
    GLOB_PATTERN,
    HOST_PATTERN,
    NAME_PATTERN,
    POINT_NAME_PATTERN,
    PROM_FILE_PATTERN,
    ROW_CODE_PATTERN,
    ROW_PATTERN_PATTERN,
    SPARKPLUG_ID_PATTERN,
    TOPIC_PATTERN,
    URL_PATTERN,
    USER_PATTERN,
    ConfigTable,
    short,
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


def explain(error: ValidationError) -> list[Mistake]:
    """Return every mistake that the models found in a document."""
    mistakes = []
    for detail in error.errors(include_url=False):
        if detail["type"] == "too_short" and detail["input"]:
            continue  # its items are wrong, and named one by one
        key, value = detail["loc"], detail["input"]
        mistakes.append(Mistake(key, *_words(detail["type"], key, value, detail.get("ctx", {}))))
    return mistakes


def _words(kind: str, key: Key, value: Any, ctx: Mapping[str, Any]) -> tuple[str, str]:
    """Return what is wrong, and the hint, for a kind of error of pydantic."""
    header = ".".join(str(part) for part in key if not isinstance(part, int))
    is_repeated = header in REPEATED_TABLES
    some = f"at least one [[{header}]] is needed"
    if remedy := _REMOVED.get(header if kind == "extra_forbidden" else f"{header} = {value}"):
        return "was removed in 0.3.0", remedy
    match kind:
        case "wrong":
            return ctx["what"], ctx["hint"]
        case "missing":
            table = f"a table [{header}] is needed" if len(key) == 1 else ""
            return "is missing", _MISSING_HINTS.get(header, some if is_repeated else table)
        case "extra_forbidden":
            return "unknown key", choose(key[-1], _known_keys(key[:-1]))
        case "string_pattern_mismatch":
            if ctx["pattern"] == LINE_PATTERN:  # perhaps a password: it is not shown
                return "is no password line", "paste the line that starter-gateway web-password prints"
            return f"is {short(value)}", _PATTERN_HINTS[ctx["pattern"]]
        case "string_too_short":
            return "is empty", "leave the key out, or give it a value"
        case "string_too_long":
            return f"has {len(value)} characters", f"at most {ctx['max_length']}"
        case "literal_error":
            known = re.findall(r"'([^']*)'", ctx["expected"]) if isinstance(value, str) else []
            return f"is {short(value)}", choose(value, known) if known else f"must be {ctx['expected']}"
        case "too_short":
            return "is empty", some if is_repeated else "name at least one"
        case "tuple_type" if is_repeated:
            return "is not a list of tables", f"write [[{header}]], with two brackets"
        case "tuple_type":
            return f"is {short(value)}", 'must be a list, e.g. ["start", "stop"]'
        case "model_type":
            return f"is {short(value)}", f"must be a table, [{header}]"
        case _:
            return f"is {short(value)}", demand_of(kind, ctx)


# Keys, and values of keys, that earlier versions knew, with the remedy.
_REMOVED = {
    "operator.freshness = boot": "leave it out; the client sends the token of B/gateway/fresh, or issued_at",
    "line.learn_response_times": "leave it out; where replies are sure to be sooner, set response_time_s",
    "line.starter.fast_words": "leave it out: all points are read where they are",
}
_MISSING_HINTS = {
    "web.user.operator": "name the client of an [[operator]]: the login has its rights",
    "web.user.password": "paste the line that starter-gateway web-password prints",
}
_PATTERN_HINTS = {
    NAME_PATTERN: "only a-z, 0-9, _ and -",
    GLOB_PATTERN: "only a-z, 0-9, _ and -, and * or ? for any others",
    ROW_CODE_PATTERN: "a code as the manual prints it, in capitals, such as P102 or C5.3.9",
    ROW_PATTERN_PATTERN: "a code of the manual, such as S1.1.1, with * and ? for any others",
    POINT_NAME_PATTERN: "a letter, then only a-z, 0-9 and _",
    SPARKPLUG_ID_PATTERN: "one level of a topic: without +, / and #",
    TOPIC_PATTERN: "levels of a topic, such as homeassistant/status: only letters, digits, _ . and -",
    URL_PATTERN: "an address that begins with http:// or https://",
    FIRMWARE_PATTERN: "two numbers with a point between them, such as 1.30",
    USER_PATTERN: "only letters, digits, _ . @ and -",
    HOST_PATTERN: "a name or address without port, such as mcc1.plant",
    BASE_PATH_PATTERN: "a path such as /mcc1",
    PROM_FILE_PATTERN: "a file whose name ends in .prom: node-exporter reads no others",
}


def _known_keys(table: Key) -> list[str]:
    model: type[BaseModel] = Config
    for part in table:
        if isinstance(part, str):
            field = next(f for name, f in model.model_fields.items() if (f.alias or name) == part)
            types = (field.annotation, *get_args(field.annotation))
            model = next(t for t in types if isinstance(t, type) and issubclass(t, BaseModel))
    return [field.alias or name for name, field in model.model_fields.items()]


Document = Mapping[str, Any]
Tables = Mapping[Key, ConfigTable]  # those that are right by themselves


def tables_in(
    document: Any, made: Mapping[int, ConfigTable], key: Key = ()
) -> Iterator[tuple[Key, ConfigTable]]:
    """Yield the tables that were made of parts of a document, with their keys; `made` is by the part's id."""
    if id(document) in made:
        yield key, made[id(document)]
    is_list = isinstance(document, list)
    parts = document.items() if isinstance(document, dict) else enumerate(document) if is_list else ()
    for name, part in parts:
        yield from tables_in(part, made, (*key, name))


def texts_in(document: Any, *path: str) -> list[str]:
    """Return the texts of one key in all tables of a path: `line`, `starter`, `name`; of wrong tables too."""
    if not path:
        return [document] if isinstance(document, str) else []
    if isinstance(document, list):
        return [text for part in document for text in texts_in(part, *path)]
    return texts_in(document.get(path[0]), *path[1:]) if isinstance(document, Mapping) else []


def again(
    seen: dict[object, Key], key: Key, value: str | int, hint: str, *, by: object = None
) -> Iterator[Mistake]:
    """Yield a value that another key has too; `seen` is what came before, `by` what is compared instead."""
    by = by or value
    if by in seen:
        yield Mistake(key, f"{short(value)} is also {spell(seen[by])}", hint)
    seen.setdefault(by, key)
