"""Events: what can happen, as a closed list, each with its words; `texts/events.toml` is the table of them.

A caller gives a code and named fields. The table makes the text of the fields that its template names, and
`data` of those that are keys of `data`. A call with a field too many or too few is an error, which
`tests/contract/test_uses.py` finds without running the code. A field whose name is taken has an underscore
behind: `from_`, `severity_`.
"""

from __future__ import annotations

import enum
from collections.abc import Mapping
from typing import Any, NamedTuple

from gateway.contract.vocabulary import Severity
from gateway.contract.wording import Meaning, table

EventCode = enum.StrEnum(  # the value of each is its name in lower case; in the groups of the table
    "EventCode",
    "STARTED STOPPED FAULT ALARM CLEARED ALARM_ACKNOWLEDGED START_DRIFT START_DRIFT_OVER ONE_START_LEFT "
    "LOCAL_OPERATION REMOTE_OPERATION "
    "STOP_UNCONFIRMED COMMAND_CUT_SHORT LOCKED UNLOCKED MALFORMED_TOPIC MEMORY_WRITTEN "
    "WENT_SILENT ANSWERS_AGAIN DEGRADED RECOVERED IDENTITY_MISMATCH IDENTITY_UNKNOWN IDENTITY_CHANGED "
    "SLOT_MISMATCH IDENTITY_ACCEPTED "
    "READINESS PARAMETER_CHANGED "
    "PORT_OPEN PORT_AWAY PORT_DEAF ADDRESS_CONFLICT FOREIGN_TRAFFIC LATE_REPLIES CABLE "
    "LINE_SATURATED LINE_RELIEVED WATCHDOG_UNKEPT "
    "BROKER_CONNECTED BROKER_AWAY CLIENT_ID_TAKEN BASE_SHARED LEFTOVERS_UNREAD MESSAGE_TOO_LARGE "
    "MQTT_3_1_1 MQTT_5 PUBLISH_REFUSED GAP "
    "WEB_OPEN WEB_CERTIFICATE WEB_AWAY "
    "METRICS_AWAY METRICS_BACK "
    "SPARKPLUG_BORN SPARKPLUG_AWAY DCMD_REFUSED "
    "PLUGIN_BEHIND "
    "STOPPING RELOADED RELOAD_REFUSED RELOAD_FAILED "
    "CLOCK_TRUSTED CLOCK_STEPPED STOOD_STILL LAG "
    "STORE_UNAVAILABLE STORE_AVAILABLE STORE_SLOW STORE_LOST "
    "HISTORY_UNAVAILABLE HISTORY_AVAILABLE HISTORY_LOST MEMORY_DAMAGED",
)


class EventMeaning(Meaning):
    """The meaning of a code: for people, and in its fields."""

    severities: tuple[Severity, ...]
    data: Mapping[str, str] = {}  # meaning by key, in the order of the JSON
    optional: frozenset[str] = frozenset()  # keys of `data` that are absent where they are None
    phrases: Mapping[str, str] = {}  # templates of parts of a text, which the gateway uses elsewhere too


EVENTS: Mapping[EventCode, EventMeaning] = {
    EventCode(code): EventMeaning.model_validate(row) for code, row in table("events").items()
}


class Event(NamedTuple):
    """Something that happened, in words and as data; `event_of` makes it."""

    code: EventCode
    severity: Severity
    text: str
    data: Mapping[str, Any]


def event_of(code: EventCode, case: str = "", /, *, severity: Severity | None = None, **fields: Any) -> Event:
    """Return an event with its text; a severity is given where the code has several. KeyError."""
    meaning = EVENTS[code]
    given = {name.removesuffix("_"): value for name, value in fields.items()}
    data = {
        name: given[name]
        for name in meaning.data
        if name not in meaning.optional or given.get(name) is not None
    }
    return Event(code, severity or meaning.severities[0], meaning.texts[case].format_map(given), data)


def phrase(code: EventCode, name: str, /, **fields: object) -> str:
    """Return a part of an event's text, in words; KeyError for a field that is missing."""
    return EVENTS[code].phrases[name].format_map(fields)
