"""What every topic carries: the source of docs/reference/topics.md and asyncapi.yaml.

The tests beside compare it with the payloads that the program makes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from gateway.history.start_record import COLUMNS, StartOutcome, StartSource
from gateway.contract import Phase, Quality, Severity
from gateway.starters.identity.registry import FIELDS as FINGERPRINT
from tests.reference.fields import (
    Field,
    any_of,
    flag,
    group,
    mapping,
    number,
    several,
    text,
    time,
    whole,
)

SEQ = whole("counts up by one over everything that this run publishes")
RUN = text("names this run of the gateway: with the topic and `seq` it names a message once and for all")
QUALITY = text(
    "good: just read; stale: the last good value, with its own time; bad: never read, refused, impossible",
    values=Quality,
)
REPLY_TIME = time("when the reply left the wire", null=True)
CODE = text("why, for programs: see the result codes")
RAW = several("the words as they were read", "whole", absent=True)
VALUE = {
    "value": any_of("the value", null=True),
    "unit": text("its unit; empty for none"),
    "label": text("its name in the manual, of an enum", null=True, absent=True),
    "raw": RAW,
    "reason": text("why there is no value", absent=True),
}
RESPONSE_TIMES = {
    "p50": number("half of the replies came within", "s", null=True),
    "p99": number("99 of 100 replies came within", "s", null=True),
}
COUNTS = {
    "answered": whole("requests that were answered"),
    "silent": whole("requests without a reply"),
    "garbled": whole("requests with a corrupted reply"),
    "refused": whole("requests that were answered by a Modbus exception"),
}


@dataclass(frozen=True)
class Topic:
    """One topic: its address below `B`, how it is delivered, and the fields of its payload."""

    name: str
    address: str
    meaning: str
    fields: Mapping[str, Field]
    qos: int = 1
    is_retained: bool = True
    extra: str = ""  # what other keys there may be
    is_received: bool = False  # by the gateway

    @property
    def is_deletable(self) -> bool:
        """Return whether it may be deleted at the broker: it is retained, and of a starter or a line."""
        return self.is_retained and "{" in self.address


PARAMETERS = {
    "starter": "name of the starter",
    "line": "name of the line",
    "point": "name of the point; the family pages list them",
    "code": "code of the fault or alarm, in lower case",
    "client": "the client's name: the broker's access list ties it to a login",
    "verb": "what to do",
}

GATEWAY = (
    Topic(
        "gatewayStatus",
        "gateway/status",
        "Whether the gateway works. `offline` is also the will, whose times are null.",
        {
            "state": text("its state", values=("starting", "online", "degraded", "offline")),
            "time": time("when this was published", null=True),
            "boot": text("names this connection; a command that carries another one is refused"),
            "since": time("since when it is in this state", null=True),
            "reason": text("why it is degraded or offline", null=True),
            "run": RUN,
        },
    ),
    Topic(
        "gatewayFresh",
        "gateway/fresh",
        "Every second, and with each stop: the proof of freshness that a command echoes.",
        {"token": text("for the `token` of a command"), "time": time("when it was issued")},
        qos=0,
    ),
    Topic(
        "gatewayInfo",
        "gateway/info",
        "What this gateway is.",
        {
            "product": text("starter-gateway"),
            "version": text("its version"),
            "contract": whole("version of what this page describes"),
            "boot": RUN,
            "mqtt_version": text("of the connection", values=("5", "3.1.1"), null=True),
            "starters": several("names", "text"),
            "lines": several("names", "text"),
            "operators": several(
                "who may do what",
                {
                    "client": text("the level in the command topic"),
                    "may": several("verbs; * for all", "text"),
                    "starters": several("names, with * and ?", "text"),
                    "freshness": text("what proves its commands fresh", values=("token", "issued_at")),
                },
            ),
            "notice": text("not a safety function"),
            "groups": mapping("members of each group, by its name", "any", absent=True),
        },
    ),
    Topic(
        "lineStatistics",
        "gateway/line/{line}",
        "Statistics of a line, every 30 s and on change.",
        {
            "crashes": whole("how often the line's loop has ended by an error, and begun anew", absent=True),
            "is_open": flag("whether its port is open"),
            "stretch": number("by how much all periods are stretched; 1: not at all"),
            "watchdogs": group(
                "what the starters' communication watchdogs need",
                {
                    "load": number("share of the line's time that they need alone"),
                    "longest_share": number("longest time without a request, as a share of the watchdog's"),
                    "unit": whole("the address that had to wait so long"),
                },
            ),
            "progress": whole("grows with each step of the line's loop"),
            "stray_bytes": whole("bytes that no request was waiting for"),
            "uart_errors": group(
                "counters of the adapter's driver, where it has them",
                {
                    "frame": whole("framing errors"),
                    "overrun": whole("overruns of the UART"),
                    "parity": whole("parity errors"),
                    "break": whole("breaks"),
                    "buffer_overrun": whole("overruns of the driver's buffer"),
                },
                absent=True,
            ),
            "utilisation": number("share of time that the line was busy, 0 to 1"),
            "time_share": group(
                "how it spends its time, as shares of it; the rest it is idle",
                {
                    "requests": number("requests on the wire"),
                    "delays": number("until the reply begins"),
                    "replies": number("replies on the wire"),
                    "silences": number("the silence before each request"),
                },
            ),
            "sweep_s": number("time for one request of each poll", "s"),
            "polls": whole("requests of polls"),
            "jobs": whole("requests of commands and of identification"),
            **COUNTS,
            "stop_latency_s": group(
                "how long a stop waits for its first byte",
                {
                    "computed": number("at most", "s"),
                    "worst": number("measured, the longest", "s", null=True),
                    "stops": whole("stops that were measured"),
                    "sum": number("of their waits", "s"),
                    "within": mapping("how many waited at most so many seconds", "whole"),
                },
            ),
            "units": mapping(
                "of each address",
                {
                    "asked": whole("requests"),
                    **COUNTS,
                    "corrupted": whole("garbled replies that were no frame"),
                    "late": whole("replies that came after their time"),
                    "response_time_s": group("of all functions", RESPONSE_TIMES),
                    "functions": mapping(
                        "response times by function code",
                        {
                            **RESPONSE_TIMES,
                            "p999": number("999 of 1000 replies came within", "s", null=True),
                        },
                    ),
                    "state": text("what is known of it", values=("new", "answering", "suspect", "silent")),
                },
            ),
            "computed": group(
                "what `check` computes",
                {
                    "load": number("share of the line's time that the polls need"),
                    "sweep_s": number("time for one request of each poll, at most", "s"),
                    "stop_latency_s": number("a stop's first byte, at most", "s"),
                    "watchdog_margin_s": number("least reserve of a communication watchdog", "s", null=True),
                    "is_paced": flag("whether the polls have periods; else the line is full at all times"),
                },
                absent=True,
            ),
            "cable": group(
                "what the errors say of the cable",
                {
                    "texts": several("findings, in words", "text"),
                    "starters": mapping("rates of errors, by starter", "any"),
                },
                absent=True,
            ),
            "lag_s": group(
                "how late the program's loops were at most",
                {"line": number("the lines'", "s"), "gateway": number("the gateway's own", "s")},
                absent=True,
            ),
        },
        qos=0,
    ),
    Topic(
        "outbox",
        "gateway/outbox",
        "What waits for the broker, every 30 s and on loss.",
        {
            "depth": whole("messages that wait"),
            "oldest_s": number("age of the oldest", "s"),
            "bytes": whole("size of what waits", "B"),
            "dropped": whole("messages that were lost"),
            "refused": whole("messages that the broker refused"),
            "reconnects": whole("connections after the first"),
        },
        qos=0,
    ),
)

_EVENT = {
    "seq": SEQ,
    "time": time("when it happened", null=True),
    "boot": RUN,
    "code": text("what happened, for programs: see the events"),
    "severity": text("error: a person must act", values=Severity),
    "text": text("what happened, for people"),
    "data": group("depends on the code: see the events", {}, extra="by code"),
}
GATEWAY += (
    Topic("gatewayEvent", "gateway/event", "What happened to the gateway.", _EVENT, is_retained=False),
)

STARTER = (
    Topic(
        "starterInfo",
        "starter/{starter}/info",
        "What a starter is.",
        {
            "family": text("its family"),
            "model": text("its model", null=True),
            "firmware": text("its firmware", null=True),
            "serial": text("its serial number", null=True),
            "hardware": text("its hardware version", null=True),
            "rated_current_a": number("its rated current", "A", null=True),
            "rating": text("SSW900: the currents of its size", null=True),
            "slot": whole("SSW900: slot of the RS-485 accessory", null=True),
            "accessories": several("SSW900: the kinds in slots 1 and 2", "any", null=True),
            "line": text("the line that it is on"),
            "address": whole("its Modbus address"),
            "points": mapping(
                "by name",
                {
                    "code": text("its code in the manual", null=True),
                    "name": text("what the manual calls it"),
                    "meaning": text("what it is, in the gateway's language"),
                    "unit": text("its unit; empty for none"),
                    "type": text("bool, int, float, enum or text"),
                    "enum": mapping("the names of its values", "text", null=True),
                    "deadband": number("a smaller change is not published", null=True),
                },
            ),
            "commands": several("the verbs that it has", "text"),
        },
    ),
    Topic(
        "starterAvailability",
        "starter/{starter}/availability",
        "Whether a starter answers.",
        {
            "state": text(
                "degraded: a part of it cannot be read; disabled: it is not asked",
                values=("online", "degraded", "offline", "disabled"),
            ),
            "since": time("since when", null=True),
            "reason": text("why it is not online", null=True),
        },
    ),
    Topic(
        "starterState",
        "starter/{starter}/state",
        "What a starter does, at once on change, else every 30 s.",
        {
            "state": text(
                "the one word for it",
                values=("ready", "starting", "running", "stopping", "fault", "not_ready", "unknown"),
            ),
            "quality": QUALITY,
            "time": time("when the oldest of its readings left the wire", null=True),
            "seq": SEQ,
            "boot": RUN,
            "reason": text("why it is unknown although the starter answers", absent=True),
            "fault_code": whole("number of the present fault, where the starter gives one", absent=True),
            "locked": group(
                "the maintenance lock; null: not locked",
                {
                    "by": text("the client that set it"),
                    "operator": text("who that client says it acts for, a claim", null=True),
                    "since": time("when it was set", null=True),
                    "reason": text("why"),
                    "notice": text("replaces no physical lock"),
                },
                null=True,
            ),
        },
        extra="each boolean point of the status by its name: true, false, or null when it is not known",
    ),
    Topic(
        "starterValue",
        "starter/{starter}/value/{point}",
        "The value of one point; on change, and again after `mqtt.refresh_s`.",
        {
            "value": any_of("true, false, a number, text, or null", null=True),
            "unit": text("its unit; empty for none"),
            "quality": QUALITY,
            "time": REPLY_TIME,
            "seq": SEQ,
            "boot": RUN,
            "label": text("the name of the value, of an enum", absent=True),
            "reason": text("why it is bad, where the starter as a whole is the cause", absent=True),
        },
    ),
    Topic(
        "starterAlarm",
        "starter/{starter}/alarm/{code}",
        "A fault or alarm that is or was active since the gateway's start.",
        {
            "active": flag("whether it is active"),
            "severity": text("a fault trips the motor", values=("fault", "alarm")),
            "text": text("what the manual calls it"),
            "time": time("when it came last", null=True),
            "cleared": time("when it went; null while it is active", null=True),
            "count": whole("how often it came"),
            "seq": SEQ,
            "boot": RUN,
        },
    ),
    Topic(
        "starterEvent",
        "starter/{starter}/event",
        "What happened to a starter.",
        _EVENT,
        is_retained=False,
    ),
    Topic(
        "starterStart",
        "starter/{starter}/start",
        "The record of one start, once it is over. A field is absent where its value is not known. After a "
        "kill the same record may come once more: `id` names it.",
        {
            "id": text("names the start"),
            "time": time("when the motor began to accelerate"),
            "boot": RUN,
            "seq": SEQ,
            "cause": group(
                "who gave the start",
                {
                    "source": text("where it came from", values=StartSource),
                    "client": text("of a command of ours", absent=True),
                    "command_id": text("of a command of ours", absent=True),
                },
            ),
            "outcome": text("how it ended; given_up: the gateway lost sight of it", values=StartOutcome),
            "standstill_s": number("at rest before, as far as it was seen", "s", absent=True),
            "rate_hz": number(
                "samples of the current during the acceleration, by its length", "Hz", absent=True
            ),
            "rated_a": number("rated current", "A", absent=True),
            "acceleration_s": number("acceleration time", "s", absent=True),
            "resolution_s": number("plus or minus, of the acceleration time", "s", absent=True),
            "peak_a": number("highest current", "A", absent=True),
            "mean_a": number("mean current while it accelerated", "A", absent=True),
            "i2t_a2s": number("integral of the squared current", "A²s", absent=True),
            "i2t_error_pct": number("plus or minus, of the I2t", "%", absent=True),
            "lowest_v": number("lowest line voltage", "V", absent=True),
            "heating_pct": number("rise of the thermal level", "%", absent=True),
            "outliers": whole(
                "readings of the current that were left out, because they cannot be", absent=True
            ),
            "is_baseline": flag("whether later starts are compared with it"),
            "drift": mapping(
                "how the last starts compare with the baseline, by quantity",
                {
                    "baseline": number("at the baseline"),
                    "median": number("of the last starts"),
                    "change_pct": number("by how much it has changed", "%"),
                },
                absent=True,
            ),
            "samples": group(
                "columns of the same length; null where a reply did not hold it",
                {
                    "t_s": several("time from the start, s", "number"),
                    **{name: several(f"the point {name}", "any", absent=True) for name in COLUMNS},
                },
            ),
        },
        is_retained=False,
    ),
    Topic(
        "starterTrip",
        "starter/{starter}/trip",
        "The record of one trip: what was read before it, and what the starter says of it.",
        {
            "id": text("names the trip"),
            "time": time("the first reading that showed it", null=True),
            "boot": RUN,
            "seq": SEQ,
            "code": text("code of the fault, in lower case; `fault` where the starter gives no number"),
            "text": text("what the manual calls it"),
            "state_before": text("null: found at the first reading", null=True),
            "readings": group(
                "what was read before it",
                {
                    "t_s": several("time from the trip, s", "number"),
                    "points": mapping("columns of the same length, by point", "any"),
                    "constant": mapping("points that did not change, by point", "any"),
                },
            ),
            "at_fault": mapping("what the starter stored at the fault, by code", "any"),
            "fault_history": several("the starter's own list, the newest first", "any"),
            "thinned": text("what was left out so that it has at most 16 KB", absent=True),
        },
        is_retained=False,
    ),
    Topic(
        "starterHistory",
        "starter/{starter}/history",
        "Values that could not be sent when they were new, at most 200 in a message.",
        {
            "boot": text("the run that they were read in"),
            "items": several(
                "the oldest first",
                {
                    "point": text("the point"),
                    "value": any_of("its value", null=True),
                    "quality": QUALITY,
                    "time": REPLY_TIME,
                    "seq": SEQ,
                },
            ),
        },
        is_retained=False,
    ),
)

_COMMAND = {
    "id": text("names this one decision, 1 to 64 characters; every verb but stop needs it", absent=True),
    "token": text("of gateway/fresh: the proof of freshness", absent=True),
    "issued_at": text("RFC 3339 time with offset: the proof on a synchronised clock", absent=True),
    "ttl_s": number("how old the proof may be, at most 60; 5 when absent", "s", absent=True),
    "boot": text("of gateway/status: one that is not the present one is refused", absent=True),
    "operator": text("who decides, a claim; for the audit", absent=True),
    "reason": text("why, for the audit; at most 256 characters", absent=True),
    "args": group("what the verb needs", {}, absent=True, extra="by verb"),
    "expect": mapping("points and the values that they must have, at most 16", "any", absent=True),
    "select": text("token of a `select` before", absent=True),
}

COMMANDS = (
    Topic(
        "command",
        "command/{starter}/{client}/{verb}",
        "From an operator, never retained. `stop` needs no payload at all.",
        _COMMAND,
        is_retained=False,
        is_received=True,
    ),
    Topic(
        "result",
        "result/{starter}/{client}",
        "Each phase of a command; exactly one final result ends it.",
        {
            "id": text("of the command", null=True),
            "verb": text("of the command"),
            "phase": text("the last four are final", values=Phase),
            "code": CODE,
            "text": text("why, for people"),
            "time": time("when", null=True),
            "duplicate": flag("whether this is the stored result of an id that was used before"),
            "parameter": text("what was read or set", absent=True),
            "value": any_of("its value", null=True, absent=True),
            "unit": text("its unit", absent=True),
            "label": text("its name in the manual, of an enum", null=True, absent=True),
            "raw": RAW,
            "reason": text("why there is no value", absent=True),
            "values": mapping("several parameters, by code", VALUE, absent=True),
            "select": text("select: the token for the command to come", absent=True),
            "valid_s": number("select: how long it is valid", "s", absent=True),
            "state": text("select: the state that it holds for; crashed: the state now", absent=True),
            "start": text("baseline: the start that others are compared with", absent=True),
            "by": text("lock_removed: the client that removed it", absent=True),
            "count": whole("too_many: commands that this answers together", absent=True),
            **{
                name: text("accept: what the device that was accepted says", null=True, absent=True)
                for name in FINGERPRINT
            },
            "members": mapping(
                "of a group: what became of each member",
                {"phase": text("its final phase", values=Phase), "code": CODE},
                absent=True,
            ),
        },
        is_retained=False,
    ),
    Topic(
        "audit",
        "audit",
        "Every decision about a command.",
        {
            "seq": SEQ,
            "time": time("when", null=True),
            "starter": text("the starter"),
            "client": text("who commanded, by the broker's login"),
            "verb": text("what"),
            "args": group("its arguments", {}, extra="as they were sent"),
            "decision": text("the final phase, or duplicate"),
            "code": CODE,
            "before": group("points before the write", {}, extra="by name"),
            "after": group("points after it", {}, extra="by name"),
            "id": text("of the command", null=True),
            "operator": text("who decided, a claim", null=True),
            "reason": text("why, a claim", null=True),
            "source": text("which way it came, where not by MQTT: web, sparkplug", absent=True),
            "boot": RUN,
        },
        is_retained=False,
    ),
)

TOPICS = (*GATEWAY, *STARTER, *COMMANDS)
