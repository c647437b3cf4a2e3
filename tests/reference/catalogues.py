"""Tables of what is listed in the product: its events, its results, its metrics."""

from __future__ import annotations

from itertools import groupby

from gateway.contract import EventCode, ResultCode
from gateway.contract.events import EVENTS
from gateway.contract.results import RESULTS
from gateway.plugins.metrics.catalogue import METRICS
from tests.reference.markdown import table

EVENTS_HEAD = """\
# Events

<!-- Made by `make docs` from gateway/contract/texts/events.toml; edit the table there. -->

An event is something that happened once.
Those of a starter come on `B/starter/{starter}/event`, those of the gateway on `B/gateway/event`
([fields](topics.md)); none is retained.
`code` names it for programs, `text` says it for people, `data` holds the fields below.
The severity `error` means that a person must act.
This list is closed.
"""


def events_page() -> str:
    """Return docs/reference/events.md."""
    head = ("code", "severity", "what happened", "what to do", "`data`")
    groups = groupby(EVENTS, lambda code: EVENTS[code].group)
    return "\n".join([EVENTS_HEAD, *(table(f"## {title}", head, map(_event, of)) for title, of in groups)])


def results() -> str:
    """Return the codes of results."""
    head = ("code", "what it says", "what to do")
    groups = groupby(RESULTS, lambda code: RESULTS[code].group)
    return "\n".join(table(f"### {title}", head, map(_result, of)) for title, of in groups)


def metrics() -> str:
    """Return a table for each group of metrics."""
    head = ("metric", "type", "labels", "meaning")
    return "\n".join(
        table(
            f"### {group}",
            head,
            (
                (f"`{name}`", spec.kind, ", ".join(f"`{label}`" for label in spec.labels), spec.help)
                for name, spec in of.items()
            ),
        )
        for group, of in METRICS.items()
    )


def _event(code: EventCode) -> tuple[str, ...]:
    event = EVENTS[code]
    fields = "<br>".join(f"`{name}`: {meaning}" for name, meaning in event.data.items())
    return f"`{code}`", ", ".join(event.severities), event.sentence, event.remedy, fields


def _result(code: str) -> tuple[str, ...]:
    shown = "exception_N" if code == ResultCode.EXCEPTION else code
    return f"`{shown}`", RESULTS[code].sentence, RESULTS[code].remedy
