"""A plant that is scraped in virtual time, and what a scrape says, read by prometheus-client's own parser."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar, cast

from prometheus_client.parser import text_string_to_metric_families

from gateway.app.integrations.integration import Integration, IntegrationHost
from gateway.app.integrations.metrics import GatewaySource, metrics_integration
from gateway.app.site import Site
from gateway.config.load import parse
from gateway.metrics.catalogue import PREFIX
from gateway.metrics.scrape import MetricsSource, ScrapedGateway, ScrapedLine, ScrapedStarter
from gateway.mqtt.outbox.outbox import Outbox
from gateway.records import LockRecord, Quality
from gateway.starters.telemetry.snapshot import Reading
from gateway.system.stalls import DelayCounts, LagMeter
from gateway.web.interface import MetricsAccess
from tests.plant_rig import SITE, RunningPlant, running

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


class StandingOutbox:
    """An outbox in which one message waits."""

    is_connected = True

    def statistics(self, now_s: float) -> dict[str, Any]:
        return {**OUTBOX, "depth": 1, "oldest_s": 5.0, "bytes": 100}


def site_of(*tables: str, folder: Path = Path("/nowhere"), token: str | None = None) -> Site:
    """Return the rig's site with these tables besides."""
    config = parse(SITE + "\n" + "\n".join(tables), "site.toml")
    return Site(config, folder, None, (), metrics_token=token)


METRICS = "[web]\n[metrics]\n"


@dataclass
class ScrapedPlant:
    """A plant of four families with its metrics."""

    rig: RunningPlant
    integration: Integration
    events: list[str] = field(default_factory=list)
    locks: dict[str, LockRecord] = field(default_factory=dict)

    async def scrape(self) -> Scrape:
        service = cast("MetricsAccess", self.integration.service)
        return Scrape(await service.text())


@asynccontextmanager
async def scraped_plant(
    site: Site | None = None,
    *,
    wrap: Callable[[MetricsSource], MetricsSource] = lambda source: source,
    in_thread: Callable[[Callable[[], Any]], Awaitable[Any]] = here,
    settled_s: float = 30.0,
) -> AsyncIterator[ScrapedPlant]:
    """Run the plant with metrics from its first second on, unless `site` wants none."""
    async with running(0.0) as rig:
        events: list[str] = []
        locks: dict[str, LockRecord] = {}
        source = GatewaySource(
            name="plant",
            plant=rig.plant,
            outbox=cast("Outbox", StandingOutbox()),
            clock=rig.records.clock,
            started_s=rig.records.clock.utc_s(),
            clock_doubt=lambda: None,
            lock_of=locks.get,
            loops={"gateway": LagMeter(), "lines": LagMeter()},
            streams=lambda: 1,
        )
        integration = metrics_integration(
            IntegrationHost(
                site_of(METRICS) if site is None else site,
                rig.records.clock,
                lambda: True,
                lambda code, *_: events.append(code),
                in_thread,
            ),
            wrap(source),
        )
        bus = rig.records.sink
        bus.connect(*bus._subscribers, integration)
        task = asyncio.create_task(integration.run())
        await asyncio.sleep(settled_s)
        yield ScrapedPlant(rig, integration, events, locks)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
