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
from typing import Any, NamedTuple, cast

from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.metrics_core import Metric
from prometheus_client.registry import Collector
from prometheus_client.samples import Sample

from gateway import __version__
from gateway.contract import CONTRACT_VERSION, Quality, ValueRecord
from gateway.families import STATES, Profile, once_per_profile, unnumbered
from gateway.plugins.interface import Gateway, ShownStarter
from gateway.plugins.metrics.catalogue import MOTOR_POINTS, PREFIX, SPECS
from gateway.plugins.metrics.counts import Counted
from gateway.starters import OWN_POINT_NAMES, Reading
from gateway.system.stalls import Delays

OUTCOMES = ("answered", "silent", "garbled", "refused")
QUANTILES = {"0.5": "p50", "0.99": "p99"}
DIGITS = 6  # of a converted value: 12.3 kW are 12300 W

Labels = dict[str, str]


class Scrape(NamedTuple):
    """The content of a scrape, as references that the application's loop has gathered."""

    gateway: Gateway
    gauges: Mapping[str, float | None]  # of metrics without labels
    loops: Mapping[str, Delays]  # by loop, how late it was
    lines: Mapping[str, Mapping[str, Any]]  # the statistics of each, at most about a second old
    starters: Mapping[str, ShownStarter]
    locked: frozenset[str]
    counted: Counted
    has_all_points: bool

    @classmethod
    def of(cls, gateway: Gateway, counted: Counted, *, has_all_points: bool) -> Scrape:
        """Gather everything, at once and without asking any line."""
        outbox, page = gateway.mqtt.statistics(), gateway.plugin("web")
        oldest_s = gateway.clock.utc_s() - outbox["oldest_s"] if outbox["depth"] else None
        gauges = {
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
        starters, lock_of = dict(gateway.starters), gateway.policy.motor_history.lock_of
        return cls(
            gateway,
            gauges,
            {name: meter.delays.taken() for name, meter in gateway.loops.items()},
            {name: line.statistics() for name, line in gateway.lines().items()},
            starters,
            frozenset(name for name in starters if lock_of(name) is not None),
            counted,
            has_all_points,
        )


def exposition(scrape: Scrape) -> bytes:
    """Return the text of one scrape (format 0.0.4)."""
    registry = CollectorRegistry(auto_describe=False)
    registry.register(ScrapeCollector(scrape))
    return generate_latest(registry)


class ScrapeCollector(Collector):
    """Yields each metric's family, one after the other, and each sample as it is written."""

    def __init__(self, scrape: Scrape) -> None:
        self._scrape = scrape
        self._counts = scrape.counted.counts
        enabled = [each for each in scrape.starters.values() if each.setup.is_enabled]
        self._starters = [(_labels_of(each), each) for each in enabled]
        self._lines = [({"line": name}, line) for name, line in scrape.lines.items() if line]

    def describe(self) -> Iterable[Metric]:
        """Describe nothing: each scrape has a registry of its own."""
        return ()

    def collect(self) -> Iterator[Metric]:
        """Yield what is known."""
        yield from self._gateway()
        yield from self._line_metrics()
        yield from self._starter_metrics()
        yield from self._requests()
        yield from self._counters()

    def _gateway(self) -> Iterator[Metric]:
        scrape = self._scrape
        labels = {"gateway": scrape.gateway.name, "version": __version__, "contract": str(CONTRACT_VERSION)}
        yield _family("build_info", [(labels, 1.0)])
        yield _histograms("loop_lag_seconds", (({"loop": name}, each) for name, each in scrape.loops.items()))
        for name, value in scrape.gauges.items():
            yield _family(name, [({}, value)])

    def _line_metrics(self) -> Iterator[Metric]:
        for name, value_of in LINE_VALUES.items():
            yield _family(name, ((labels, value_of(line)) for labels, line in self._lines))
        stops = ((labels, _delays_of(line["stop_latency_s"])) for labels, line in self._lines)
        yield _histograms("stop_latency_seconds", stops)
        yield _family("polls_total", (pair for each in self._lines for pair in _outcomes(*each)))

    def _starter_metrics(self) -> Iterator[Metric]:
        scrape, starters = self._scrape, self._starters
        yield _family("starter_info", ((_info_labels(each), 1.0) for each in scrape.starters.values()))
        states = (
            ({**labels, "state": state}, state == each.state) for labels, each in starters for state in STATES
        )
        yield _family("starter_state", states)
        yield _family(
            "starter_locked", ((labels, each.setup.name in scrape.locked) for labels, each in starters)
        )
        for name, value_of in STARTER_VALUES.items():
            yield _family(name, ((labels, value_of(each)) for labels, each in starters))
        yield _family("point_value", self._points())

    def _requests(self) -> Iterator[Metric]:
        """Yield what the lines say of their units."""
        asked = []
        for labels, starter in self._starters:
            unit = self._scrape.lines.get(starter.setup.line, {}).get("units", {}).get(starter.setup.address)
            if unit is not None:
                asked.append((labels, unit))
        yield _family("starter_polls_total", (pair for each in asked for pair in _outcomes(*each)))
        yield _family(
            "starter_response_seconds",
            (
                ({**labels, "quantile": quantile}, unit["response_time_s"][key])
                for labels, unit in asked
                for quantile, key in QUANTILES.items()
            ),
        )

    def _points(self) -> Iterator[tuple[Labels, float | None]]:
        """Yield the points that the configuration asks for: by name, or all, with those of the gateway."""
        for labels, starter in self._starters:
            readings, points = starter.snapshot.readings, starter.profile.points
            for point, reading in readings.items():
                is_asked = self._scrape.has_all_points or points[point].every_s is not None
                if is_asked and point not in MOTOR_POINTS:
                    yield {**labels, "point": point, "unit": reading.unit}, _good(reading)
            for point in sorted(OWN_POINT_NAMES.difference(readings) if self._scrape.has_all_points else ()):
                topic = ValueRecord.topic_of(starter=starter.setup.name, point=point)
                record = self._scrape.gateway.latest.find(topic)
                if isinstance(record, ValueRecord):
                    yield {**labels, "point": point, "unit": record.unit}, _good(record)

    def _counters(self) -> Iterator[Metric]:
        for name in ("starts_total", "start_drifts_total", "commands_unconfirmed_total"):
            yield _family(name, self._of_starters(name))
        yield _family("trips_total", self._trips())
        for name in ("commands_total", "commands_rejected_total"):
            keys = self._counts.get(name, {}).items()
            yield _family(name, ((dict(zip(SPECS[name].labels, key, strict=True)), n) for key, n in keys))
        times = self._scrape.counted.times.items()
        yield _histograms("command_seconds", (({"verb": verb}, delays) for verb, delays in times))

    def _of_starters(self, name: str) -> list[tuple[Labels, float]]:
        """Return a counter of each starter, from 0 on: Prometheus sees no increase from nothing to 1."""
        counts = self._counts.get(name, {})
        return [(labels, counts.get((each.setup.name,), 0)) for labels, each in self._starters]

    def _trips(self) -> Iterator[tuple[Labels, float]]:
        """Yield the trips by each code that the family names, from 0 on, and by each that was seen."""
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


def _family(name: str, samples: Iterable[tuple[Labels, float | None]]) -> Metric:
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


def _outcomes(labels: Labels, counts: Mapping[str, Any]) -> list[tuple[Labels, float]]:
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


def _last_s(starter: ShownStarter, qualities: tuple[Quality, ...]) -> float | None:
    """Return when a value that has one of these qualities was last read."""
    return starter.snapshot.last_s(qualities)


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
    "starter_last_reply_timestamp_seconds": partial(_last_s, qualities=tuple(Quality)),
    "starter_last_good_reading_timestamp_seconds": partial(_last_s, qualities=(Quality.GOOD, Quality.STALE)),
    "starter_fault_active": _fault,
    "starter_fault_code": _fault_code,
    **{motor.metric: partial(_converted, point=point) for point, motor in MOTOR_POINTS.items()},
}
