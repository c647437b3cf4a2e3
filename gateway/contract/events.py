"""Events: what can happen, as a closed list, each with its words; `texts/events.toml` is the table of them.

A caller gives a code and named fields. The table makes the text of the fields that its template names, and
`data` of those that are keys of `data`; a field that is missing, or that nothing names, is an error. A field
whose name is taken has an underscore behind: `from_`, `severity_`.
"""

from __future__ import annotations

import enum
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from string import Formatter
from typing import Any

from pydantic import BaseModel, ConfigDict, field_validator

from gateway.contract.vocabulary import Severity

_TABLE = resources.files("gateway.contract") / "texts" / "events.toml"


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
    STORE_UNAVAILABLE = "store_unavailable"
    STORE_AVAILABLE = "store_available"
    STORE_SLOW = "store_slow"
    STORE_LOST = "store_lost"
    HISTORY_UNAVAILABLE = "history_unavailable"
    HISTORY_AVAILABLE = "history_available"
    HISTORY_LOST = "history_lost"
    MEMORY_DAMAGED = "memory_damaged"


class EventMeaning(BaseModel):
    """What a code means: for people, and in its fields."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    group: str
    severities: tuple[Severity, ...]
    sentence: str
    remedy: str
    data: Mapping[str, str] = {}  # meaning by key, in the order of the JSON
    optional: frozenset[str] = frozenset()  # keys of `data` that are absent where they are None
    texts: Mapping[str, str]  # templates by case; one template alone has the case ""
    phrases: Mapping[str, str] = {}  # templates of parts of a text, which the gateway uses elsewhere too

    @field_validator("texts", mode="before")
    @classmethod
    def _one(cls, texts: object) -> object:
        return {"": texts} if isinstance(texts, str) else texts

    def required(self, case: str) -> frozenset[str]:
        """Return the fields that a caller must give."""
        return fields_in(self.texts[case]) | (self.data.keys() - self.optional)


def fields_in(template: str) -> frozenset[str]:
    """Return the names of the fields that a template is filled with."""
    return frozenset(name for _, name, _, _ in Formatter().parse(template) if name)


EVENTS: Mapping[EventCode, EventMeaning] = {
    EventCode(code): EventMeaning.model_validate(row)
    for code, row in tomllib.loads(_TABLE.read_text("utf-8")).items()
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
