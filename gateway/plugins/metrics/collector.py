"""The metrics of one scrape as prometheus-client's families; for a thread of its own.

An unknown value has no sample: a series that ends is seen, a value that stands still is believed. Readings
come from the starters' snapshots, not from published values: those are as old as `refresh_s` allows while
nothing changes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from operator import itemgetter
from typing import Any, cast

from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.metrics_core import Metric
from prometheus_client.samples import Sample

from gateway import __version__
from gateway.contract import CONTRACT_VERSION, Quality, ValueRecord
from gateway.families import STATES, Profile, once_per_profile, unnumbered
from gateway.plugins.interface import Gateway, ShownStarter
from gateway.plugins.metrics.catalogue import MOTOR_POINTS, PREFIX, SPECS
from gateway.starters import OWN_POINT_NAMES, Reading
from gateway.system.stalls import Delays

OUTCOMES = ("answered", "silent", "garbled", "refused")
QUANTILES = {"0.5": "p50", "0.99": "p99"}
DIGITS = 6  # of a converted value: 12.3 kW are 12300 W

Labels = dict[str, str]
LabelledValue = tuple[Labels, float | None]


class Scrape:
    """The content of one scrape: gathered at once on the application's loop, written by a thread."""

    def __init__(
        self,
        gateway: Gateway,
        counts: Mapping[str, Mapping[tuple[str, ...], int]],
        command_times: Mapping[str, Delays],
        *,
        has_all_points: bool,
    ) -> None:
        """Gather references, without asking any line; `counts` are by metric, `command_times` by verb."""
        outbox, page, lock_of = (
            gateway.mqtt.statistics(),
            gateway.plugin("web"),
            gateway.policy.motor_history.lock_of,
        )
        oldest_s = gateway.clock.utc_s() - outbox["oldest_s"] if outbox["depth"] else None
        self._gateway = gateway
        self._counts = counts
        self._command_times = command_times
        self._has_all_points = has_all_points
        self._gauges: Mapping[str, float | None] = {
            "start_timestamp_seconds": gateway.started_s,
            "clock_synchronised": gateway.clock_doubt() is None,
            "web_streams": getattr(page, "streams", None),
            "broker_connected": gateway.mqtt.is_connected(),
            "broker_reconnects_total": outbox["reconnects"],
            "outbox_messages": outbox["depth"],
            "outbox_bytes": outbox["bytes"],
            "outbox_oldest_timestamp_seconds": oldest_s,
            "outbox_dropped_total": outbox["dropped"],
            "outbox_refused_total": outbox["refused"],
        }
        self._loops = {name: meter.delays.taken() for name, meter in gateway.loops.items()}
        self._lines = {name: line.statistics() for name, line in gateway.lines().items()}
        self._all_starters = list(gateway.starters.values())
        self._starters = [(_labels_of(each), each) for each in self._all_starters if each.setup.is_enabled]
        self._locked = {name for name in gateway.starters if lock_of(name) is not None}

    def exposition(self) -> bytes:
        """Return the text (format 0.0.4)."""
        return generate_latest(cast("CollectorRegistry", self))

    def collect(self) -> Iterator[Metric]:
        """Yield what is known: each metric's family, one after the other."""
        for name, samples in self._numbers():
            yield _family(name, samples)
        yield _histograms("loop_lag_seconds", (({"loop": name}, each) for name, each in self._loops.items()))
        stops = (({"line": name}, _delays_of(line["stop_latency_s"])) for name, line in self._open_lines())
        yield _histograms("stop_latency_seconds", stops)
        times = self._command_times.items()
        yield _histograms("command_seconds", (({"verb": verb}, delays) for verb, delays in times))

    def _open_lines(self) -> list[tuple[str, Mapping[str, Any]]]:
        return [(name, line) for name, line in self._lines.items() if line]

    def _numbers(self) -> Iterator[tuple[str, Iterable[LabelledValue]]]:
        """Yield by metric its samples; what counts for a starter is there from 0 on.

        Prometheus sees no increase from nothing to 1.
        """
        gateway, starters, counts = self._gateway, self._starters, self._counts
        about = {"gateway": gateway.name, "version": __version__, "contract": str(CONTRACT_VERSION)}
        yield "build_info", [(about, 1.0)]
        for name, value in self._gauges.items():
            yield name, [({}, value)]
        lines = [({"line": name}, line) for name, line in self._open_lines()]
        for name, of_line in LINE_VALUES.items():
            yield name, ((labels, of_line(line)) for labels, line in lines)
        yield "polls_total", (pair for each in lines for pair in _outcomes(*each))
        yield "starter_info", ((_info_labels(each), 1.0) for each in self._all_starters)
        yield (
            "starter_state",
            (
                ({**labels, "state": state}, state == each.state)
                for labels, each in starters
                for state in STATES
            ),
        )
        yield "starter_locked", ((labels, each.setup.name in self._locked) for labels, each in starters)
        for name, of_starter in STARTER_VALUES.items():
            yield name, ((labels, of_starter(each)) for labels, each in starters)
        yield "point_value", self._points()
        asked = [(labels, unit) for labels, each in starters if (unit := self._unit_of(each)) is not None]
        yield "starter_polls_total", (pair for each in asked for pair in _outcomes(*each))
        yield (
            "starter_response_seconds",
            (
                ({**labels, "quantile": quantile}, unit["response_time_s"][key])
                for labels, unit in asked
                for quantile, key in QUANTILES.items()
            ),
        )
        for name in ("starts_total", "start_drifts_total", "commands_unconfirmed_total"):
            of = counts.get(name, {})
            yield name, [(labels, of.get((each.setup.name,), 0)) for labels, each in starters]
        yield "trips_total", self._trips()
        for name in ("commands_total", "commands_rejected_total"):
            names = SPECS[name].labels
            yield name, [(dict(zip(names, key, strict=True)), n) for key, n in counts.get(name, {}).items()]

    def _unit_of(self, starter: ShownStarter) -> Mapping[str, Any] | None:
        """Return what its line says of a starter."""
        units: Mapping[int, Any] = self._lines.get(starter.setup.line, {}).get("units", {})
        return units.get(starter.setup.address)

    def _points(self) -> Iterator[LabelledValue]:
        """Yield the points that the configuration asks for: by name, or all, with those of the gateway."""
        for labels, starter in self._starters:
            readings, points = starter.snapshot.readings, starter.profile.points
            for point, reading in readings.items():
                is_asked = self._has_all_points or points[point].every_s is not None
                if is_asked and point not in MOTOR_POINTS:
                    yield {**labels, "point": point, "unit": reading.unit}, _good(reading)
            for point in sorted(OWN_POINT_NAMES.difference(readings) if self._has_all_points else ()):
                topic = ValueRecord.topic_of(starter=starter.setup.name, point=point)
                record = self._gateway.latest.find(topic)
                if isinstance(record, ValueRecord):
                    yield {**labels, "point": point, "unit": record.unit}, _good(record)

    def _trips(self) -> Iterator[LabelledValue]:
        """Yield the trips by each code that the family names, and by each that was seen."""
        seen = self._counts.get("trips_total", {})
        for labels, starter in self._starters:
            counts = dict.fromkeys(fault_codes(starter.profile), 0)
            counts |= {code: count for (name, code), count in seen.items() if name == starter.setup.name}
            for code, count in counts.items():
                yield {**labels, "code": code}, count


@once_per_profile
def fault_codes(profile: Profile) -> tuple[str, ...]:
    """Return the codes that trips of a family have: those that it names, and that without a number."""
    codes = [each.code for each in profile.alarms if each.severity == "fault"]
    return (*codes, unnumbered(profile, "fault").code)


def _family(name: str, samples: Iterable[LabelledValue]) -> Metric:
    full = PREFIX + name
    return _made(name, (Sample(full, labels, float(value)) for labels, value in samples if value is not None))


def _histograms(name: str, all_delays: Iterable[tuple[Labels, Delays]]) -> Metric:
    return _made(name, (sample for labels, delays in all_delays for sample in _buckets(name, labels, delays)))


def _buckets(name: str, labels: Labels, delays: Delays) -> Iterator[Sample]:
    full, within = PREFIX + name, delays.within
    for bound_s, count in zip((*delays.bounds_s, math.inf), within, strict=True):
        le = "+Inf" if bound_s == math.inf else repr(float(bound_s))
        yield Sample(f"{full}_bucket", {**labels, "le": le}, count)
    yield Sample(f"{full}_sum", labels, delays.total_s)
    yield Sample(f"{full}_count", labels, within[-1])


def _made(name: str, samples: Iterator[Sample]) -> Metric:
    """Return a family whose samples are made one by one as they are written.

    Thousands at once would be looked through by the garbage collector, for which every thread stands still:
    with 247 starters loops were up to 130 ms late.
    """
    spec = SPECS[name]
    family = Metric(PREFIX + name.removesuffix("_total"), spec.help, spec.kind)
    family.samples = cast("list[Sample]", samples)  # they are read once, in order
    return family


def _delays_of(stops: Mapping[str, Any]) -> Delays:
    within = [*stops["within"].values(), stops["stops"]]
    counts = tuple(count - before for count, before in zip(within, [0, *within], strict=False))
    return Delays(tuple(map(float, stops["within"])), counts, stops["sum"])


def _outcomes(labels: Labels, counts: Mapping[str, Any]) -> list[LabelledValue]:
    return [({**labels, "outcome": outcome}, counts[outcome]) for outcome in OUTCOMES]


def _labels_of(starter: ShownStarter) -> Labels:
    return {"line": starter.setup.line, "starter": starter.setup.name}


def _info_labels(starter: ShownStarter) -> Labels:
    model, firmware = starter.variant.model or "", starter.variant.firmware or ""
    return {**_labels_of(starter), "family": starter.profile.family, "model": model, "firmware": firmware}


def _good(reading: Reading | ValueRecord | None) -> float | None:
    value = None if reading is None or reading.quality is not Quality.GOOD else reading.value
    is_number = isinstance(value, (bool, int, float)) and math.isfinite(value)
    return float(value) if value is not None and is_number else None


def _converted(starter: ShownStarter, point: str) -> float | None:
    """Return a point of the motor in the unit of its metric."""
    reading = starter.snapshot.readings.get(point)
    value, factors = _good(reading), MOTOR_POINTS[point].factors
    if reading is None or value is None or reading.unit not in factors:
        return None
    return round(value * factors[reading.unit], DIGITS)


def _fault(starter: ShownStarter) -> float | None:
    return _good(starter.snapshot.readings.get("fault"))


def _fault_code(starter: ShownStarter) -> float | None:
    """Return the fault's number; without a fault the row holds that of the last one (SSW-07, P014)."""
    return (_good(starter.snapshot.readings.get("fault_code")) or None) if _fault(starter) else None


LINE_VALUES: Mapping[str, Callable[[Mapping[str, Any]], float | None]] = {
    "line_open": itemgetter("is_open"),
    "line_utilisation_ratio": itemgetter("utilisation"),
    "line_sweep_seconds": itemgetter("sweep_s"),
    "line_stop_latency_bound_seconds": lambda line: line["stop_latency_s"]["computed"],
    "line_stop_latency_worst_seconds": lambda line: line["stop_latency_s"]["worst"],
}
STARTER_VALUES: Mapping[str, Callable[[ShownStarter], float | None]] = {
    "starter_online": lambda starter: starter.is_answering,
    "starter_last_reply_timestamp_seconds": lambda starter: starter.snapshot.last_s(),
    "starter_last_good_reading_timestamp_seconds": lambda starter: starter.snapshot.last_s(
        (Quality.GOOD, Quality.STALE)
    ),
    "starter_fault_active": _fault,
    "starter_fault_code": _fault_code,
    **{motor.metric: partial(_converted, point=point) for point, motor in MOTOR_POINTS.items()},
}
