"""From records to metrics: all that a birth names, with the newest value of each; pure.

A metric's name is the point's. Beside the points there are `state`, `availability`, `reason`, `locked`,
`alarm/*`, `Properties/*` and, where commands are taken, `Command/*`. A record of a point that no `info` has
named is left out: no birth would have named it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

from gateway.contract import (
    AlarmRecord,
    AvailabilityRecord,
    InfoRecord,
    LineRecord,
    Quality,
    Record,
    ResultRecord,
    StateRecord,
    ValueRecord,
)
from gateway.families.profile.load import load_profile
from gateway.plugins.sparkplug.payload import BAD, FALSE, GOOD, STALE, DataType, Metric, Value
from gateway.starters.policy.rights import Rights

STOP_METRIC = "Command/Stop"
COMMANDS = {STOP_METRIC: "stop", "Command/Start": "start", "Command/Reset": "reset"}
ID_PREFIX = "spb-"  # of the ids of commands that came this way
ANSWERING = frozenset({"online", "degraded"})

_TYPES = {
    "boolean": DataType.BOOLEAN,
    "float": DataType.DOUBLE,
    "integer": DataType.INT64,
    "enum": DataType.INT64,
    "string": DataType.STRING,
}
_QUALITY = {Quality.GOOD: None, Quality.STALE: STALE, Quality.BAD: BAD}


class MetricTable:
    """Metrics by name with their newest values; a change is what differs in value or quality.

    What is not known yet is dated `since_s`: hosts that order by time then prefer whatever is read later.
    """

    def __init__(self, since_s: float = 0.0) -> None:
        self.since_s = since_s
        self._metrics: dict[str, Metric] = {}
        self.edition = 0  # grows when a name comes or goes: a new birth is needed

    def define(self, name: str, datatype: DataType, value: Value = None, **texts: str) -> None:
        """Name a metric; one that is there with this type keeps its value."""
        present = self._metrics.get(name)
        properties = tuple((key, text) for key, text in texts.items() if text)
        if present is not None and present.datatype is datatype:
            self._metrics[name] = replace(present, properties=properties)
            return
        quality = BAD if value is None else None
        self._metrics[name] = Metric(name, datatype, value, self.since_s, quality, properties)
        self.edition += 1

    def remove_all_but(self, names: frozenset[str]) -> None:
        """Forget every other metric."""
        for name in [name for name in self._metrics if name not in names]:
            del self._metrics[name]
            self.edition += 1

    def set(
        self,
        name: str,
        value: Value,
        *,
        time_s: float | None,
        quality: int | None = None,
        always: bool = False,
    ) -> Iterator[Metric]:
        """Take a value; yield what is to be sent of it, without the properties of the birth."""
        present = self._metrics.get(name)
        if present is None:
            return
        fitting = _fitting(present.datatype, value)
        if fitting is None and quality is None and value is not None:
            quality = BAD
        if not always and (fitting, quality) == (present.value, present.quality):
            return
        at_s = present.time_s if time_s is None else time_s
        self._metrics[name] = replace(present, value=fitting, quality=quality, time_s=at_s)
        said = GOOD if quality is None and present.quality is not None else quality  # good again: said once
        yield Metric(name, present.datatype, fitting, at_s, said)

    def birth(self) -> tuple[Metric, ...]:
        """Return all metrics."""
        return tuple(self._metrics.values())


class StarterMetrics:
    """The metrics of one starter, fed with its records."""

    def __init__(self, *, since_s: float, operator: str | None, rights: Rights) -> None:
        self._operator = operator
        self._rights = rights
        self._alarms: dict[str, AlarmRecord] = {}
        self._machine: tuple[str, str, int] | None = None
        self.table = MetricTable(since_s)
        self.is_known = False  # what its metrics are
        self.is_answering = False

    def take(self, record: Record, utc_s: float) -> list[Metric]:
        """Take a record of this starter, at that time; return the metrics that it changes."""
        match record:
            case ValueRecord():
                quality = _QUALITY[record.quality]
                value = None if record.time_s is None else record.value
                return [*self.table.set(record.point, value, time_s=record.time_s, quality=quality)]
            case StateRecord():
                return [*self._state(record)]
            case AvailabilityRecord():
                self.is_answering = record.state in ANSWERING
                return [*self._texts(record.since_s, availability=record.state, reason=record.reason or "")]
            case AlarmRecord():
                return [*self._alarm(record)]
            case InfoRecord():
                return [*self._info(record, utc_s)]
            case ResultRecord():
                return [*self._result(record)]
            case _:
                return []

    def command_done(self, name: str, time_s: float) -> list[Metric]:
        """Return a command's metric as false again: what was written to it has been taken."""
        return [*self.table.set(name, FALSE, time_s=time_s, always=True)]

    def _state(self, record: StateRecord) -> Iterator[Metric]:
        quality, time_s = _QUALITY[record.quality], record.time_s
        yield from self.table.set("state", record.state, time_s=time_s, quality=quality)
        for name, flag in record.flags.items():
            of_flag = (quality or BAD) if flag is None else quality
            yield from self.table.set(name, flag, time_s=time_s, quality=of_flag)
        yield from self.table.set("locked", record.lock is not None, time_s=time_s)

    def _alarm(self, record: AlarmRecord) -> Iterator[Metric]:
        """Show the fault that came last, else the alarm that came last."""
        if record.is_active:
            self._alarms[record.code] = record
        else:
            self._alarms.pop(record.code, None)
        time_s = record.time_s if record.cleared_s is None else record.cleared_s
        shown = max(
            self._alarms.values(), key=lambda each: (each.severity == "fault", each.time_s), default=None
        )
        yield from self.table.set("alarm/active", shown is not None, time_s=time_s)
        yield from self.table.set("alarm/count", len(self._alarms), time_s=time_s)
        if shown is None:
            yield from self._texts(time_s, **{"alarm/code": "", "alarm/text": "", "alarm/severity": ""})
        else:
            texts = {"alarm/code": shown.code, "alarm/text": shown.text, "alarm/severity": shown.severity}
            yield from self._texts(time_s, **texts)

    def _info(self, record: InfoRecord, utc_s: float) -> Iterator[Metric]:
        machine = (record.family, record.line, record.address)
        if machine != self._machine:  # what another one has said is not this one's, and older
            if self._machine is not None:
                self.table.since_s = utc_s
            self._machine = machine
            self.table.remove_all_but(frozenset())
            self._alarms.clear()
        for name, point in record.points.items():
            datatype = _TYPES.get(str(point.get("type")), DataType.STRING)
            self.table.define(
                name, datatype, engUnit=_text(point, "unit"), Documentation=_text(point, "name")
            )
        for name in ("state", "availability", "reason", "alarm/code", "alarm/text", "alarm/severity"):
            self.table.define(name, DataType.STRING, "")
        for name in ("alarm/active", "locked"):
            self.table.define(name, DataType.BOOLEAN, FALSE)
        self.table.define("alarm/count", DataType.INT64, 0)
        commands = self._define_commands(record)
        facts = {
            "Properties/Hardware Make": load_profile(record.family).title.partition(" ")[0],
            "Properties/Hardware Model": record.model or record.family,
            "Properties/Family": record.family,
            "Properties/FW": record.firmware or "",
            "Properties/Serial": record.serial or "",
            "Properties/Line": record.line,
        }
        for name in facts:
            self.table.define(name, DataType.STRING, "")
        self.table.define("Properties/Address", DataType.INT64, record.address)
        own = {"state", "availability", "reason", "locked", "Properties/Address", *facts}
        alarms = {f"alarm/{each}" for each in ("code", "text", "severity", "active", "count")}
        self.table.remove_all_but(frozenset({*record.points, *own, *alarms, *commands}))
        self.is_known = True
        yield from self._texts(None, **facts)
        yield from self.table.set("Properties/Address", record.address, time_s=None)

    def _define_commands(self, record: InfoRecord) -> set[str]:
        """Name what the operator may write, of what the starter's family knows; nothing without one."""
        client, starter = self._operator, record.starter
        if client is None:
            return set()
        writable = [
            name
            for name, verb in COMMANDS.items()
            if verb in record.commands and self._rights.is_allowed(client, verb=verb, starter=starter)
        ]
        for name in writable:
            self.table.define(name, DataType.BOOLEAN, FALSE)
        last = [f"Command/Last/{each}" for each in ("Verb", "Id", "Phase", "Code", "Text")]
        for name in last:
            self.table.define(name, DataType.STRING, "")
        return {*writable, *last}

    def _result(self, record: ResultRecord) -> Iterator[Metric]:
        """Show what became of a command, if it came this way."""
        if record.client != self._operator or not (record.id or "").startswith(ID_PREFIX):
            return
        said = {"Verb": record.verb, "Id": record.id, "Phase": str(record.phase)}
        for name, text in {**said, "Code": record.code, "Text": record.text}.items():
            yield from self.table.set(f"Command/Last/{name}", text, time_s=record.time_s, always=True)

    def _texts(self, time_s: float | None, /, **texts: str) -> Iterator[Metric]:
        for name, text in texts.items():
            yield from self.table.set(name, text, time_s=time_s)


class NodeMetrics:
    """The metrics of the gateway itself: its lines, its connection to the main broker, its properties."""

    def __init__(
        self, properties: Mapping[str, str], lines: tuple[str, ...], facts: Mapping[str, Value]
    ) -> None:
        self.table = MetricTable()
        self._facts = {name: _type_of(value) for name, value in facts.items()}
        self._properties = properties
        self.move(lines)
        for name, value in facts.items():
            list(self.table.set(name, value, time_s=None))

    def move(self, lines: tuple[str, ...]) -> None:
        """Name the metrics of these lines."""
        for name, text in self._properties.items():
            self.table.define(name, DataType.STRING, text)
        for name, datatype in self._facts.items():
            self.table.define(name, datatype)
        of_lines = [f"line/{line}/{each}" for line in lines for each in ("utilisation", "sweep_s")]
        for name in of_lines:
            self.table.define(name, DataType.DOUBLE)
        self.table.remove_all_but(frozenset({*self._properties, *self._facts, *of_lines}))

    def take(self, record: LineRecord, time_s: float) -> list[Metric]:
        """Take a line's statistics."""
        return [
            metric
            for name in ("utilisation", "sweep_s")
            for metric in self.table.set(f"line/{record.line}/{name}", record.data.get(name), time_s=time_s)
        ]

    def note(self, facts: Mapping[str, Value], time_s: float) -> list[Metric]:
        """Take what the gateway says of itself; return what is news."""
        return [
            metric for name, value in facts.items() for metric in self.table.set(name, value, time_s=time_s)
        ]


def _fitting(datatype: DataType, value: Value) -> Value:
    """Return a value as its metric's type; None where it has none."""
    if value is None:
        return None
    try:
        match datatype:
            case DataType.BOOLEAN:
                return bool(value)
            case DataType.DOUBLE:
                return float(value)
            case DataType.STRING:
                return str(value)
            case _:
                return int(value)
    except (ValueError, OverflowError):
        return None


def _type_of(value: Value) -> DataType:
    match value:
        case bool():
            return DataType.BOOLEAN
        case int():
            return DataType.INT64
        case float():
            return DataType.DOUBLE
        case _:
            return DataType.STRING


def _text(point: Mapping[str, Any], key: str) -> str:
    value = point.get(key)
    return "" if value is None else str(value)
