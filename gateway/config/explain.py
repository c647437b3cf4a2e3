"""Words for what the models refuse: pydantic's own, and a hint where it cannot know one."""

from __future__ import annotations

import re

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from gateway.config.mistakes import Mistake, choose, short
from gateway.config.schema import REPEATED_TABLES, TABLES
from gateway.config.values import PATTERN_HINTS
from gateway.system.password_hash import LINE_PATTERN
from gateway.system.value_demands import demand_of

_PASTE = "paste the line that starter-gateway web-password prints"
_EMPTY = {"too_short": "name at least one", "string_too_short": "leave the key out, or give it a value"}
_MISSING = {
    "web.user.operator": "name the client of an [[operator]]: the login has its rights",
    "web.user.password": _PASTE,
}
_REMOVED = {  # keys, and values of keys, that earlier versions knew, with the remedy
    "operator.freshness = boot": "leave it out; the client sends the token of B/gateway/fresh, or issued_at",
    "line.learn_response_times": "leave it out; where replies are sure to be sooner, set response_time_s",
    "line.starter.fast_words": "leave it out: all points are read where they are",
}


def explain(error: ValidationError) -> list[Mistake]:
    """Return every mistake that the models found in a document."""
    return [
        Mistake(detail["loc"], *_words(detail))
        for detail in error.errors(include_url=False)
        if detail["type"] != "too_short" or not detail["input"]  # else its items are wrong: each is named
    ]


def _words(detail: ErrorDetails) -> tuple[str, str]:
    """Return what is wrong, and the hint."""
    kind, value, ctx = detail["type"], detail["input"], detail.get("ctx", {})
    table, name = [part for part in detail["loc"][:-1] if isinstance(part, str)], detail["loc"][-1]
    header = ".".join([*table, name] if isinstance(name, str) else table)
    several = f"at least one [[{header}]] is needed" if header in REPEATED_TABLES else ""
    needed = several or (f"a table [{header}] is needed" if header in TABLES else "")
    if remedy := _REMOVED.get(header if kind == "extra_forbidden" else f"{header} = {value}"):
        return "was removed in 0.3.0", remedy
    match kind:
        case "wrong":
            return ctx["what"], ctx["hint"]
        case "missing":
            return "is missing", _MISSING.get(header, needed)
        case "extra_forbidden":
            return "unknown key", choose(name, TABLES[".".join(table)])
        case "string_pattern_mismatch" if ctx["pattern"] == LINE_PATTERN:  # perhaps a password: not shown
            return "is no password line", _PASTE
        case "string_pattern_mismatch":
            return f"is {short(value)}", PATTERN_HINTS[ctx["pattern"]]
        case "too_short" | "string_too_short":
            return "is empty", several or _EMPTY[kind]
        case "literal_error" if isinstance(value, str) and "'" in ctx["expected"]:
            return f"is {short(value)}", choose(value, re.findall(r"'([^']*)'", ctx["expected"]))
        case "tuple_type" if several:
            return "is not a list of tables", f"write [[{header}]], with two brackets"
        case _:
            demand = f"must be a table, [{header}]" if kind == "model_type" else demand_of(detail)
            return f"is {short(value)}", demand
