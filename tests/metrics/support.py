"""A gateway to be scraped, and what a scrape says, read by prometheus-client's own parser."""

from __future__ import annotations

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

from prometheus_client.parser import text_string_to_metric_families

from gateway.contract import Latest, Quality
from gateway.families.profile.load import load_profile
from gateway.plugins.metrics.catalogue import PREFIX
from gateway.plugins.metrics.collector import Scrape as Gathered
from gateway.plugins.metrics.counts import Counted
from gateway.starters.telemetry.snapshot import Reading
from gateway.system.stalls import LagMeter

NOW_S = 1_760_000_000.0
NOTHING = Counted({}, {})
OUTBOX = {"depth": 0, "oldest_s": 0.0, "bytes": 0, "dropped": 0, "refused": 0, "reconnects": 0}
UNIT = {
    "answered": 90,
    "silent": 5,
    "garbled": 4,
    "refused": 1,
    "response_time_s": {"p50": 0.01, "p99": None},
}
LINE = {
    "is_open": True,
    "utilisation": 0.5,
    "sweep_s": 1.5,
    "answered": 190,
    "silent": 5,
    "garbled": 4,
    "refused": 1,
    "stop_latency_s": {
        "computed": 0.25,
        "worst": 0.04,
        "stops": 3,
        "sum": 0.06,
        "within": {"0.01": 1, "0.025": 2, "0.05": 3},
    },
    "units": {1: UNIT},
}


def good(value: Any, unit: str = "", *, time_s: float = NOW_S) -> Reading:
    return Reading(value, unit, Quality.GOOD, at_s=1.0, time_s=time_s)


def starter(name: str = "pump-1", **changes: Any) -> Any:
    """Return a starter as plugins see it."""
    said = {
        "address": 1,
        "model": "SSW-07 85A",
        "state": "running",
        "readings": {},
        "profile": load_profile("ssw07"),
        **changes,
    }
    return SimpleNamespace(
        setup=SimpleNamespace(name=name, line="pumps", address=said["address"], is_enabled=True),
        variant=SimpleNamespace(model=said["model"], firmware=None),
        profile=said["profile"],
        state=said["state"],
        is_answering=True,
        snapshot=SimpleNamespace(readings=said["readings"]),
    )


def gathered(*starters: Any, counted: Counted = NOTHING, streams: int | None = 2) -> Gathered:
    """Return what a scrape gathers of a gateway with these starters."""
    lag = LagMeter()
    lag.delays.note(0.005)
    gateway: Any = SimpleNamespace(
        name="mcc1",
        started_s=NOW_S - 60.0,
        clock=SimpleNamespace(utc_s=lambda: NOW_S),
        clock_doubt=lambda: None,
        mqtt=SimpleNamespace(statistics=lambda: OUTBOX, is_connected=lambda: True),
        plugin=lambda _: None if streams is None else SimpleNamespace(streams=streams),
        loops={"gateway": lag},
        lines=lambda: {"pumps": SimpleNamespace(statistics=lambda: LINE)},
        starters={each.setup.name: each for each in starters},
        policy=SimpleNamespace(motor_history=SimpleNamespace(lock_of=lambda _: None)),
        latest=Latest(),
    )
    return Gathered.of(gateway, counted, has_all_points=False)


class Scrape:
    """One scrape, as a reader sees it: names without the prefix."""

    def __init__(self, text: bytes) -> None:
        self.text = text
        self.types: dict[str, str] = {}
        self.samples: dict[str, list[tuple[Mapping[str, str], float]]] = {}
        for family in text_string_to_metric_families(text.decode("utf-8")):
            self.types[family.name.removeprefix(PREFIX)] = family.type
            for sample in family.samples:
                name = sample.name.removeprefix(PREFIX)
                self.samples.setdefault(name, []).append((sample.labels, sample.value))

    def all(self, name: str, **labels: str) -> list[float]:
        """Return the values of every series that has these labels."""
        return [value for found, value in self.samples.get(name, []) if labels.items() <= dict(found).items()]

    def one(self, name: str, **labels: str) -> float:
        (value,) = self.all(name, **labels)
        return value
