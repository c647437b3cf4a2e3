"""Events: what can happen, as a closed list, each with its words; `texts/events.toml` is the table of them.

A caller gives a code and named fields. The table makes the text of the fields that its template names, and
`data` of those that are keys of `data`; a field that is missing, or that nothing names, is an error. A field
whose name is taken has an underscore behind: `from_`, `severity_`.
"""

from __future__ import annotations

import enum
from collections.abc import Mapping, Set
from dataclasses import dataclass
from typing import Any

from gateway.contract.vocabulary import Severity
from gateway.contract.wording import Meaning, names_in, table


class EventCode(enum.StrEnum):
    """What happened, for programs."""

    STARTED = "started"
    STOPPED = "stopped"
    FAULT = "fault"
    ALARM = "alarm"
    CLEARED = "cleared"
    START_DRIFT = "start_drift"
    START_DRIFT_OVER = "start_drift_over"
    ONE_START_LEFT = "one_start_left"
    LOCAL_OPERATION = "local_operation"
    REMOTE_OPERATION = "remote_operation"
    STOP_UNCONFIRMED = "stop_unconfirmed"
    COMMAND_CUT_SHORT = "command_cut_short"
    LOCKED = "locked"
    UNLOCKED = "unlocked"
    MALFORMED_TOPIC = "malformed_topic"
    MEMORY_WRITTEN = "memory_written"
    WENT_SILENT = "went_silent"
    ANSWERS_AGAIN = "answers_again"
    DEGRADED = "degraded"
    RECOVERED = "recovered"
    IDENTITY_MISMATCH = "identity_mismatch"
    IDENTITY_UNKNOWN = "identity_unknown"
    IDENTITY_CHANGED = "identity_changed"
    SLOT_MISMATCH = "slot_mismatch"
    IDENTITY_ACCEPTED = "identity_accepted"
    READINESS = "readiness"
    PARAMETER_CHANGED = "parameter_changed"
    PORT_OPEN = "port_open"
    PORT_AWAY = "port_away"
    PORT_DEAF = "port_deaf"
    ADDRESS_CONFLICT = "address_conflict"
    BABBLING = "babbling"
    LINE_NOISE = "line_noise"
    CABLE = "cable"
    LINE_SATURATED = "line_saturated"
    LINE_RELIEVED = "line_relieved"
    WATCHDOG_UNKEPT = "watchdog_unkept"
    BROKER_CONNECTED = "broker_connected"
    BROKER_AWAY = "broker_away"
    CLIENT_ID_TAKEN = "client_id_taken"
    BASE_SHARED = "base_shared"
    LEFTOVERS_UNREAD = "leftovers_unread"
    MESSAGE_TOO_LARGE = "message_too_large"
    MQTT_3_1_1 = "mqtt_3_1_1"
    MQTT_5 = "mqtt_5"
    PUBLISH_REFUSED = "publish_refused"
    GAP = "gap"
    WEB_OPEN = "web_open"
    WEB_CERTIFICATE = "web_certificate"
    WEB_AWAY = "web_away"
    METRICS_AWAY = "metrics_away"
    METRICS_BACK = "metrics_back"
    SPARKPLUG_BORN = "sparkplug_born"
    PLUGIN_BEHIND = "plugin_behind"
    SPARKPLUG_AWAY = "sparkplug_away"
    DCMD_REFUSED = "dcmd_refused"
    STOPPING = "stopping"
    RELOADED = "reloaded"
    RELOAD_REFUSED = "reload_refused"
    RELOAD_FAILED = "reload_failed"
    CLOCK_TRUSTED = "clock_trusted"
    CLOCK_STEPPED = "clock_stepped"
    STOOD_STILL = "stood_still"
    LAG = "lag"
    LEDGER_UNAVAILABLE = "ledger_unavailable"
    LEDGER_AVAILABLE = "ledger_available"
    LEDGER_SLOW = "ledger_slow"
    LEDGER_LOST = "ledger_lost"
    AUDIT_UNAVAILABLE = "audit_unavailable"
    AUDIT_AVAILABLE = "audit_available"
    OUTBOX_UNAVAILABLE = "outbox_unavailable"
    OUTBOX_AVAILABLE = "outbox_available"
    OUTBOX_LOST = "outbox_lost"
    HISTORY_UNAVAILABLE = "history_unavailable"
    HISTORY_AVAILABLE = "history_available"
    HISTORY_LOST = "history_lost"
    MEMORY_AWAY = "memory_away"
    MEMORY_BACK = "memory_back"
    MEMORY_DAMAGED = "memory_damaged"
    IDENTITIES_AWAY = "identities_away"
    IDENTITIES_BACK = "identities_back"


class EventMeaning(Meaning):
    """What a code means: for people, and in its fields."""

    severities: tuple[Severity, ...]
    data: Mapping[str, str] = {}  # meaning by key, in the order of the JSON
    optional: frozenset[str] = frozenset()  # keys of `data` that are absent where they are None
    phrases: Mapping[str, str] = {}  # templates of parts of a text, which the gateway uses elsewhere too

    def required(self, case: str) -> Set[str]:
        """Return the fields that a caller must give."""
        return names_in(self.texts[case]) | (self.data.keys() - self.optional)


EVENTS: Mapping[EventCode, EventMeaning] = {
    EventCode(code): EventMeaning.model_validate(row) for code, row in table("events").items()
}


@dataclass(frozen=True, slots=True)
class Event:
    """Something that happened, in words and as data; `event_of` makes it."""

    code: EventCode
    severity: Severity
    text: str
    data: Mapping[str, Any]


def event_of(code: EventCode, case: str = "", /, *, severity: Severity | None = None, **fields: Any) -> Event:
    """Return an event with its text; a severity is given where the code has several."""
    meaning = EVENTS[code]
    given = {name.removesuffix("_"): value for name, value in fields.items()}
    if given.keys() | meaning.optional != meaning.required(case) | meaning.optional:
        raise TypeError(f"{code} {case}: {sorted(given)} instead of {sorted(meaning.required(case))}")
    chosen = meaning.severities if severity is None else (severity,)
    if len(chosen) != 1 or chosen[0] not in meaning.severities:
        raise TypeError(f"{code}: {severity} instead of one of {meaning.severities}")
    data = {
        name: given[name]
        for name in meaning.data
        if name not in meaning.optional or given.get(name) is not None
    }
    return Event(code, chosen[0], meaning.texts[case].format_map(given), data)


def phrase(code: EventCode, name: str, /, **fields: object) -> str:
    """Return a part of an event's text, in words; KeyError for a field that is missing."""
    return EVENTS[code].phrases[name].format_map(fields)
