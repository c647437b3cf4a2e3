"""What a value must be: pydantic's words made plain, for the configuration and commands."""

from __future__ import annotations

import re

from pydantic_core import ErrorDetails

_PLAIN = {  # pydantic's words, and those that are shown
    "Value error, ": "",
    r"^\w+ should": "must",
    "^Field required": "is missing",
    "^(Extra inputs are not permitted|Unexpected keyword argument)": "is no known key",
    "^Input is not a valid path.*": "must be a path in quotes",
    "a valid string": "a text in quotes",
    "a valid integer": "a whole number",
    "a valid number": "a number",
    "a valid boolean": "true or false",
    "a valid tuple": "a list",
    r"a valid dictionary( or instance of \w+)?": "a table of names and values",
    "greater than or equal to": "at least",
    "less than or equal to": "at most",
    "greater than": "more than",
    " after validation": "",
}


def demand_of(detail: ErrorDetails) -> str:
    """Return what one of pydantic's mistakes demands, such as "must be at most 247"."""
    text = detail["msg"]
    for theirs, ours in _PLAIN.items():
        text = re.sub(theirs, ours, text)
    return text
