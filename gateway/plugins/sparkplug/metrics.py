"""From records to metrics: all that a birth names, and what each record says of it; pure.

A metric's name is the point's. Beside the points there are `state`, `availability`, `reason`, `locked`,
`alarm/*`, `Properties/*` and, where commands are taken, `Command/*`. A record of a point that no `info` has
named is left out: no birth would have named it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

from gateway.contract import (
    AlarmRecord,
    AvailabilityRecord,
    InfoRecord,
    Quality,
    Record,
    ResultRecord,
    StateRecord,
    ValueRecord,
)
from gateway.families import load_profile
from gateway.plugins.sparkplug.payload import BAD, FALSE, STALE, DataType, Metric, Value
from gateway.plugins.sparkplug.settings import SparkplugSettings
from gateway.starters import Rights

STOP_METRIC = "Command/Stop"
COMMANDS = {STOP_METRIC: "stop", "Command/Start": "start", "Command/Reset": "reset"}
ID_PREFIX = "spb-"  # of the ids of commands that came this way

_TYPES = {
    "boolean": DataType.BOOLEAN,
    "float": DataType.DOUBLE,
    "integer": DataType.INT64,
    "enum": DataType.INT64,
    "string": DataType.STRING,
}
_PYTHON: Mapping[DataType, Callable[[Any], Value]] = {
    DataType.BOOLEAN: bool,
    DataType.INT64: int,
    DataType.DOUBLE: float,
    DataType.STRING: str,
}
_QUALITY = {Quality.GOOD: None, Quality.STALE: STALE, Quality.BAD: BAD}
_TEXTS = ("state", "availability", "reason", "alarm/code", "alarm/text", "alarm/severity")
_OTHERS: Mapping[str, Value] = {"alarm/active": FALSE, "locked": FALSE, "alarm/count": 0}
_RESULT = dict.fromkeys([f"Command/Last/{each}" for each in ("Verb", "Id", "Phase", "Code", "Text")], "")


class MetricFact(NamedTuple):
    """The value of one metric in a record; without a time it is as old as the node or device."""

    name: str
    value: Value
    time_s: float | None = None
    quality: int | None = None


Metrics = Mapping[str, Metric]  # by name


def defined(facts: Mapping[str, Value], time_s: float = 0.0) -> dict[str, Metric]:
    """Return metrics of the types that these values have."""
    return {name: Metric(name, _type_of(value), value, time_s) for name, value in facts.items()}


def described(info: InfoRecord, settings: SparkplugSettings, *, since_s: float) -> dict[str, Metric]:
    """Return every metric of a starter, as it is before anything was read.

    It is dated `since_s`: hosts that order by time then prefer whatever is read later.
    """
    found = {}
    for name, point in info.points.items():
        texts = [("engUnit", point.get("unit")), ("Documentation", point.get("name"))]
        properties = tuple((key, str(text)) for key, text in texts if text)
        datatype = _TYPES.get(str(point.get("type")), DataType.STRING)
        found[name] = Metric(name, datatype, None, since_s, BAD, properties)
    answers: dict[str, Value] = {}
    if settings.operator is not None:
        may = Rights(settings.rights).is_allowed
        for name, verb in COMMANDS.items():
            if verb in info.commands and may(settings.operator, verb=verb, starter=info.starter):
                answers[name] = FALSE
        answers |= _RESULT
    facts = {fact.name: fact.value for fact in facts_of(info)}
    return found | defined({**dict.fromkeys(_TEXTS, ""), **_OTHERS, **answers, **facts}, since_s)


def facts_of(record: Record | None) -> Iterator[MetricFact]:
    """Yield what a record of a starter says; of an alarm nothing, since all of them are shown as one."""
    match record:
        case ValueRecord():
            value = None if record.time_s is None else record.value
            yield MetricFact(record.point, value, record.time_s, _QUALITY[record.quality])
        case StateRecord():
            quality = _QUALITY[record.quality]
            yield MetricFact("state", record.state, record.time_s, quality)
            for name, flag in record.flags.items():
                of_flag = (quality or BAD) if flag is None else quality
                yield MetricFact(name, flag, record.time_s, of_flag)
            yield MetricFact("locked", record.lock is not None, record.time_s)
        case AvailabilityRecord():
            yield MetricFact("availability", record.state, record.since_s)
            yield MetricFact("reason", record.reason or "", record.since_s)
        case InfoRecord():
            maker = load_profile(record.family).title.partition(" ")[0]
            yield MetricFact("Properties/Hardware Make", maker)
            yield MetricFact("Properties/Hardware Model", record.model or record.family)
            yield MetricFact("Properties/Family", record.family)
            yield MetricFact("Properties/FW", record.firmware or "")
            yield MetricFact("Properties/Serial", record.serial or "")
            yield MetricFact("Properties/Line", record.line)
            if record.title:
                yield MetricFact("Properties/Title", record.title)
            yield MetricFact("Properties/Address", record.address)
        case ResultRecord():
            said = (record.verb, record.id, str(record.phase), record.code, record.text)
            for name, text in zip(_RESULT, said, strict=True):
                yield MetricFact(name, text, record.time_s)


def alarm_facts(alarms: Iterable[AlarmRecord]) -> Iterator[MetricFact]:
    """Show the fault that came last, else the alarm that came last; `alarms` have no time order."""
    known = list(alarms)
    active = [each for each in known if each.is_active]
    time_s = max((each.cleared_s or each.time_s for each in known), default=None)
    shown = max(active, key=lambda each: (each.severity == "fault", each.time_s), default=None)
    yield MetricFact("alarm/active", shown is not None, time_s)
    yield MetricFact("alarm/count", len(active), time_s)
    for name in ("code", "text", "severity"):
        yield MetricFact(f"alarm/{name}", "" if shown is None else getattr(shown, name), time_s)


def filled(metrics: Metrics, facts: Iterable[MetricFact]) -> Iterator[Metric]:
    """Yield the metrics that facts are of, with their values; each as its type is."""
    for name, value, time_s, quality in facts:
        metric = metrics.get(name)
        if metric is not None:
            fitting = _fitting(metric.datatype, value)
            of_value = BAD if fitting is None and value is not None and quality is None else quality
            at_s = metric.time_s if time_s is None else time_s
            yield replace(metric, value=fitting, time_s=at_s, quality=of_value)


def _fitting(datatype: DataType, value: Any) -> Value:
    """Return a value as its metric's type; None where it has none."""
    if value is None:
        return None
    try:
        return _PYTHON[datatype](value)
    except (ValueError, OverflowError):
        return None


def _type_of(value: Value) -> DataType:
    return next((each for each, kind in _PYTHON.items() if type(value) is kind), DataType.STRING)
