"""Makes docs/reference/events.md from the table of events."""

from __future__ import annotations

from itertools import groupby

from gateway.contract import EventCode
from gateway.contract.events import EVENTS

HEAD = """\
# Events

<!-- Made by `make docs` from gateway/contract/texts/events.toml; edit the table there. -->

An event is something that happened once.
Those of a starter come on `B/starter/{starter}/event`, those of the gateway on `B/gateway/event`
([fields](topics.md)); none is retained.
`code` names it for programs, `text` says it for people, `data` holds the fields below.
The severity `error` means that a person must act.
This list is closed.
"""


def page() -> str:
    """Return the page."""
    parts = [HEAD]
    for title, codes in groupby(EVENTS, lambda code: EVENTS[code].group):
        head = ["| code | severity | what happened | what to do | `data` |", "|---|---|---|---|---|"]
        parts.append("\n".join([f"## {title}", "", *head, *map(_row, codes), ""]))
    return "\n".join(parts)


def _row(code: EventCode) -> str:
    event = EVENTS[code]
    severities = ", ".join(event.severities)
    fields = "<br>".join(f"`{name}`: {meaning}" for name, meaning in event.data.items())
    return f"| `{code}` | {severities} | {event.sentence} | {event.remedy} | {fields} |"
