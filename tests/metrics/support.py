"""A gateway to be scraped, and what a scrape says, read by prometheus-client's own parser."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from prometheus_client.parser import text_string_to_metric_families

from gateway.plugins.metrics.catalogue import PREFIX
from gateway.plugins.metrics.scrape import ScrapedGateway, ScrapedLine, ScrapedStarter
from gateway.contract import Quality
from gateway.starters.telemetry.snapshot import Reading
from gateway.system.stalls import DelayCounts

T = TypeVar("T")

NOW_S = 1_760_000_000.0
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


async def here(work: Callable[[], T], /) -> T:
    """Do what else a thread does."""
    return work()


def good(value: Any, unit: str = "", *, time_s: float = NOW_S) -> Reading:
    return Reading(value, unit, Quality.GOOD, at_s=1.0, time_s=time_s)


def scraped_starter(name: str = "pump-1", **changes: Any) -> ScrapedStarter:
    return ScrapedStarter(
        **{
            "name": name,
            "line": "pumps",
            "address": 1,
            "family": "ssw07",
            "model": "SSW-07 85A",
            "firmware": None,
            "is_enabled": True,
            "is_online": True,
            "is_locked": False,
            "state": "running",
            "readings": {},
            **changes,
        }
    )


def scraped_gateway(*starters: ScrapedStarter, **changes: Any) -> ScrapedGateway:
    lag = DelayCounts((0.001, 0.01))
    lag.note(0.005)
    return ScrapedGateway(
        **{
            "name": "mcc1",
            "version": "9.9",
            "contract": 1,
            "now_s": NOW_S,
            "started_s": NOW_S - 60.0,
            "is_connected": True,
            "outbox": OUTBOX,
            "is_clock_synchronised": True,
            "streams": 2,
            "loops": {"gateway": lag.taken()},
            "lines": (ScrapedLine("pumps", LINE),),
            "starters": starters,
            **changes,
        }
    )


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
