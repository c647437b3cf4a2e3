"""Wording of pydantic's mistakes, for the configuration and for commands: what a value must be."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

_KINDS = {
    "string_type": "a text in quotes",
    "path_type": "a path in quotes",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "int_parsing": "a whole number",
    "float_type": "a number",
    "float_parsing": "a number",
    "finite_number": "a finite number",
    "bool_type": "true or false",
    "bool_parsing": "true or false",
    "dict_type": "a table of names and values",
    "model_type": "a table of names and values",
    "tuple_type": "a list",
    "string_pattern_mismatch": "a text of the allowed characters",
}
_BOUNDS = {
    "greater_than": "more than",
    "greater_than_equal": "at least",
    "less_than": "less than",
    "less_than_equal": "at most",
}


def demand_of(kind: str, ctx: Mapping[str, Any]) -> str:
    """Return what pydantic's kind of mistake, with its context, demands: "must be at most 247"."""
    if kind in _KINDS:
        return f"must be {_KINDS[kind]}"
    if kind in _BOUNDS:
        return f"must be {_BOUNDS[kind]} {next(iter(ctx.values())):g}"
    match kind:
        case "string_too_long":
            return f"must have {ctx['max_length']} characters at most"
        case "string_too_short":
            return f"must have {ctx['min_length']} characters at least"
        case "too_long":
            return f"must have {ctx['max_length']} entries at most"
        case "too_short":
            return f"must have {ctx['min_length']} entries at least"
        case "missing":
            return "is missing"
        case "extra_forbidden":
            return "is no known key"
        case "literal_error":
            return f"must be {ctx['expected']}"
        case "value_error":
            return str(ctx["error"])
        case _:
            return "is not allowed here"
