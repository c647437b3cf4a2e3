"""The metrics of one scrape as prometheus-client's families; for a thread of its own.

What is not known has no sample: a series that ends is seen, a value that stands still is believed.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, cast

from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.metrics_core import Metric
from prometheus_client.registry import Collector
from prometheus_client.samples import Sample

from gateway.contract import Quality
from gateway.families import STATES
from gateway.plugins.metrics.catalogue import MOTOR_POINTS, PREFIX, SPECS, MotorPoint
from gateway.plugins.metrics.counts import Counted
from gateway.plugins.metrics.scrape import ScrapedGateway, ScrapedStarter
from gateway.starters.telemetry.snapshot import Reading
from gateway.system.stalls import Delays

OUTCOMES = ("answered", "silent", "garbled", "refused")
FAULT, FAULT_CODE = "fault", "fault_code"
QUANTILES = {"0.5": "p50", "0.99": "p99"}
DIGITS = 6  # of a converted value: 12.3 kW are 12300 W

Labels = dict[str, str]


def exposition(scraped: ScrapedGateway, counted: Counted, *, has_all_points: bool) -> bytes:
    """Return the text of one scrape (format 0.0.4)."""
    registry = CollectorRegistry(auto_describe=False)
    registry.register(ScrapeCollector(scraped, counted, has_all_points=has_all_points))
    return generate_latest(registry)


class ScrapeCollector(Collector):
    """Yields each metric's family, one after the other, and each sample as it is written."""

    def __init__(self, scraped: ScrapedGateway, counted: Counted, *, has_all_points: bool) -> None:
        self._scraped = scraped
        self._counted = counted
        self._has_all_points = has_all_points
        enabled = [each for each in scraped.starters if each.is_enabled]
        self._starters = [(each, {"line": each.line, "starter": each.name}) for each in enabled]
        self._lines = [(each, {"line": each.name}) for each in scraped.lines]

    def describe(self) -> Iterable[Metric]:
        """Describe nothing: each scrape has a registry of its own."""
        return ()

    def collect(self) -> Iterator[Metric]:
        """Yield what is known."""
        yield from self._gateway()
        yield from self._broker()
        yield from self._line_metrics()
        yield from self._states()
        yield from self._contact()
        yield from self._values()
        yield from self._counters()
        yield from self._commands()

    def _gateway(self) -> Iterator[Metric]:
        now = self._scraped
        labels = {"gateway": now.name, "version": now.version, "contract": str(now.contract)}
        yield _family("build_info", [(labels, 1.0)])
        yield _family("start_timestamp_seconds", [({}, now.started_s)])
        yield _family("clock_synchronised", [({}, now.is_clock_synchronised)])
        yield _histograms("loop_lag_seconds", [({"loop": name}, each) for name, each in now.loops.items()])
        if now.streams is not None:
            yield _family("web_streams", [({}, now.streams)])

    def _broker(self) -> Iterator[Metric]:
        now, outbox = self._scraped, self._scraped.outbox
        yield _family("broker_connected", [({}, now.is_connected)])
        yield _family("broker_reconnects_total", [({}, outbox["reconnects"])])
        yield _family("outbox_messages", [({}, outbox["depth"])])
        yield _family("outbox_bytes", [({}, outbox["bytes"])])
        if outbox["depth"]:
            yield _family("outbox_oldest_timestamp_seconds", [({}, now.now_s - outbox["oldest_s"])])
        yield _family("outbox_dropped_total", [({}, outbox["dropped"])])
        yield _family("outbox_refused_total", [({}, outbox["refused"])])

    def _line_metrics(self) -> Iterator[Metric]:
        known = [(labels, line.statistics) for line, labels in self._lines if line.statistics]
        stops = [(labels, each["stop_latency_s"]) for labels, each in known]
        yield _family("line_open", [(labels, each["is_open"]) for labels, each in known])
        yield _family("line_utilisation_ratio", [(labels, each["utilisation"]) for labels, each in known])
        yield _family("line_sweep_seconds", [(labels, each["sweep_s"]) for labels, each in known])
        for name, key in (("bound", "computed"), ("worst", "worst")):
            measured = [(labels, each[key]) for labels, each in stops if each[key] is not None]
            yield _family(f"line_stop_latency_{name}_seconds", measured)
        yield _histograms("stop_latency_seconds", [(labels, _delays_of(each)) for labels, each in stops])
        yield _family("polls_total", [pair for labels, each in known for pair in _outcomes(labels, each)])

    def _states(self) -> Iterator[Metric]:
        starters = self._starters
        yield _family("starter_info", [(_info_labels(each), 1.0) for each in self._scraped.starters])
        yield _family("starter_online", [(labels, each.is_online) for each, labels in starters])
        yield _family(
            "starter_state",
            (
                ({**labels, "state": state}, state == each.state)
                for each, labels in starters
                for state in STATES
            ),
        )
        faults = [(each, labels, _good(each.readings.get(FAULT))) for each, labels in starters]
        known = [(each, labels, is_active) for each, labels, is_active in faults if is_active is not None]
        yield _family("starter_fault_active", [(labels, is_active) for _, labels, is_active in known])
        codes = [
            (labels, _good(each.readings.get(FAULT_CODE))) for each, labels, is_active in known if is_active
        ]
        # Without a fault the row holds the number of the last one (SSW-07, P014).
        yield _family("starter_fault_code", [(labels, code) for labels, code in codes if code])
        yield _family("starter_locked", [(labels, each.is_locked) for each, labels in starters])

    def _contact(self) -> Iterator[Metric]:
        read: list[tuple[Labels, float]] = []
        good: list[tuple[Labels, float]] = []
        for each, labels in self._starters:
            last_s, good_s = _last_read_s(each.readings)
            read += [] if last_s is None else [(labels, last_s)]
            good += [] if good_s is None else [(labels, good_s)]
        yield _family("starter_last_reply_timestamp_seconds", read)
        yield _family("starter_last_good_reading_timestamp_seconds", good)
        units = {line.name: line.statistics.get("units", {}) for line in self._scraped.lines}
        asked = [
            (labels, units[each.line][each.address])
            for each, labels in self._starters
            if each.address in units.get(each.line, {})
        ]
        yield _family(
            "starter_polls_total", (pair for labels, unit in asked for pair in _outcomes(labels, unit))
        )
        yield _family(
            "starter_response_seconds",
            (
                ({**labels, "quantile": quantile}, unit["response_time_s"][key])
                for labels, unit in asked
                for quantile, key in QUANTILES.items()
                if unit["response_time_s"][key] is not None
            ),
        )

    def _values(self) -> Iterator[Metric]:
        for point, spec in MOTOR_POINTS.items():
            values = [(labels, _converted(each.readings.get(point), spec)) for each, labels in self._starters]
            yield _family(spec.metric, [(labels, value) for labels, value in values if value is not None])
        if self._has_all_points:
            yield _family("point_value", self._all_points())

    def _all_points(self) -> Iterator[tuple[Labels, float]]:
        own = self._counted.own_values
        for each, labels in self._starters:
            for point, reading in each.readings.items():
                value = None if point in MOTOR_POINTS else _good(reading)
                if value is not None:
                    yield {**labels, "point": point, "unit": reading.unit}, value
        by_name = {each.name: (each, labels) for each, labels in self._starters}
        for (starter, point), record in own.items():
            value = _number(record.value)
            if starter in by_name and value is not None and point not in by_name[starter][0].readings:
                yield {**by_name[starter][1], "point": point, "unit": record.unit}, value

    def _counters(self) -> Iterator[Metric]:
        counted = self._counted
        for name, counts in (
            ("starts_total", counted.starts),
            ("start_drifts_total", counted.drifts),
            ("commands_unconfirmed_total", counted.unconfirmed),
        ):  # from 0 on: Prometheus sees no increase in a series that begins with 1
            yield _family(name, [(labels, counts.get(each.name, 0)) for each, labels in self._starters])
        trips = {each.name: dict.fromkeys(each.fault_codes, 0) for each, _ in self._starters}
        for (name, code), count in counted.trips.items():
            if name in trips:
                trips[name][code] = count
        yield _family(
            "trips_total",
            (
                ({**labels, "code": code}, count)
                for each, labels in self._starters
                for code, count in trips[each.name].items()
            ),
        )

    def _commands(self) -> Iterator[Metric]:
        counted = self._counted
        yield _family(
            "commands_total",
            [
                ({"verb": verb, "phase": phase, "code": code}, count)
                for (verb, phase, code), count in counted.commands.items()
            ],
        )
        times = [({"verb": verb}, delays) for verb, delays in counted.command_times.items()]
        yield _histograms("command_seconds", times)
        yield _family("commands_rejected_total", [({"code": c}, n) for c, n in counted.rejected.items()])


def _family(name: str, samples: Iterable[tuple[Labels, float]]) -> Metric:
    full = PREFIX + name
    return _made(name, (Sample(full, labels, float(value)) for labels, value in samples))


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


def _outcomes(labels: Labels, counts: Mapping[str, Any]) -> list[tuple[Labels, float]]:
    return [({**labels, "outcome": outcome}, counts[outcome]) for outcome in OUTCOMES]


def _info_labels(starter: ScrapedStarter) -> Labels:
    return {
        "line": starter.line,
        "starter": starter.name,
        "family": starter.family,
        "model": starter.model or "",
        "firmware": starter.firmware or "",
    }


def _last_read_s(readings: Mapping[str, Reading]) -> tuple[float | None, float | None]:
    """Return when any value was read last, and when any was good."""
    last_s = good_s = None
    for reading in readings.values():
        time_s = reading.time_s
        if time_s is None:
            continue
        if last_s is None or time_s > last_s:
            last_s = time_s
        if reading.quality is not Quality.BAD and (good_s is None or time_s > good_s):
            good_s = time_s
    return last_s, good_s


def _good(reading: Reading | None) -> float | None:
    return None if reading is None or reading.quality is not Quality.GOOD else _number(reading.value)


def _converted(reading: Reading | None, point: MotorPoint) -> float | None:
    value = _good(reading)
    factor = None if reading is None else point.factors.get(reading.unit)
    return None if value is None or factor is None else round(value * factor, DIGITS)


def _number(value: object) -> float | None:
    if not isinstance(value, (bool, int, float)) or not math.isfinite(value):
        return None
    return float(value)
