"""Makes docs/reference/events.md from the list of event codes."""

from __future__ import annotations

from tests.reference.event_codes import EVENTS, Event

HEAD = """\
# Events

<!-- Made by `make docs` from tests/reference/event_codes.py; edit the list there. -->

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
    for title, events in EVENTS.items():
        rows = [_row(code, event) for code, event in events.items()]
        head = ["| code | severity | what happened | what to do | `data` |", "|---|---|---|---|---|"]
        parts.append("\n".join([f"## {title}", "", *head, *rows, ""]))
    return "\n".join(parts)


def _row(code: str, event: Event) -> str:
    severities = ", ".join(event.severities)
    fields = "<br>".join(f"`{name}`: {meaning}" for name, meaning in event.fields.items())
    return f"| `{code}` | {severities} | {event.sentence} | {event.hint} | {fields} |"
