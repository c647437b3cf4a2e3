"""The metrics for Prometheus: what they read of the gateway, and where the page finds them."""

from __future__ import annotations

import asyncio
import importlib
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, get_args

from gateway import __version__
from gateway.app.integrations.integration import Integration, IntegrationHost, IntegrationService
from gateway.app.plant import Plant
from gateway.app.site import Site
from gateway.config.schema import Verb
from gateway.metrics.scrape import (
    MetricsSettings,
    MetricsSource,
    ScrapedGateway,
    ScrapedLine,
    ScrapedStarter,
)
from gateway.mqtt.contract.payloads import CONTRACT_VERSION
from gateway.mqtt.outbox.outbox import Outbox
from gateway.records import LockRecord, Record, Severity
from gateway.system.clock import Clock
from gateway.system.stalls import LagMeter
from gateway.system.supervised import InThread

if TYPE_CHECKING:
    from gateway.metrics.service import MetricsService

NOT_INSTALLED = "metrics need a package that is not here: pip install 'starter-gateway[metrics]'"
VERBS = frozenset(get_args(Verb)) - {"*"}


class GatewaySource:
    """Implements `MetricsSource`: gathers references, and asks no line. On the application's loop."""

    def __init__(
        self,
        name: str,
        *,
        plant: Plant,
        outbox: Outbox,
        clock: Clock,
        clock_doubt: Callable[[], str | None],
        lock_of: Callable[[str], LockRecord | None],
        loops: Mapping[str, LagMeter],
        streams: Callable[[], int | None],
    ) -> None:
        self._name = name
        self._plant = plant
        self._outbox = outbox
        self._clock = clock
        self._clock_doubt = clock_doubt
        self._lock_of = lock_of
        self._loops = loops
        self._streams = streams
        self._started_s = clock.utc_s()

    def scraped(self) -> ScrapedGateway:
        """Return how everything is now."""
        return ScrapedGateway(
            name=self._name,
            version=__version__,
            contract=CONTRACT_VERSION,
            now_s=self._clock.utc_s(),
            started_s=self._started_s,
            is_connected=self._outbox.is_connected,
            outbox=self._outbox.statistics(self._clock.now_s()),
            is_clock_synchronised=self._clock_doubt() is None,
            streams=self._streams(),
            loops={name: meter.delays.taken() for name, meter in self._loops.items()},
            lines=tuple(ScrapedLine(name, line.statistics()) for name, line in self._plant.lines.items()),
            starters=tuple(self._starter(name) for name in self._plant.starters),
        )

    def _starter(self, name: str) -> ScrapedStarter:
        starter = self._plant.starters[name]
        setup, variant = starter.setup, starter.variant
        return ScrapedStarter(
            name=name,
            line=setup.line,
            address=setup.address,
            family=starter.profile.family,
            model=variant.model,
            firmware=variant.firmware,
            is_enabled=setup.is_enabled,
            is_online=starter.is_answering,
            is_locked=self._lock_of(name) is not None,
            state=starter.state,
            readings=starter.snapshot.readings,
        )


class MetricsExport:
    """Where the page finds the metrics, as long as they run."""

    def __init__(self) -> None:
        self.running: RunningMetrics | None = None


class RunningMetrics:
    """Implements `IntegrationService`, and `gateway.web.interface.MetricsAccess` for the page."""

    def __init__(self, service: MetricsService, site: Site, export: MetricsExport) -> None:
        self._service = service
        self._export = export
        self.token = site.metrics_token

    def put(self, record: Record) -> None:
        """Take a record, in order."""
        self._service.put(record)

    def move(self, site: Site) -> None:
        """Follow another configuration."""
        self.token = site.metrics_token
        self._service.move(metrics_settings_of(site))

    async def run(self) -> None:
        """Be there for the page, and write the file, until cancelled."""
        self._export.running = self
        try:
            await self._service.run()
        finally:
            self._export.running = None

    async def text(self) -> bytes:
        """Return what a scrape gets."""
        return await self._service.text()


def metrics_integration(
    host: IntegrationHost,
    source: MetricsSource,
    export: MetricsExport,
    *,
    in_thread: InThread = asyncio.to_thread,
) -> Integration:
    """Return the metrics, which run while the configuration has a `[metrics]`."""

    def note_trouble(trouble: str) -> None:
        if trouble:
            text = f"the metrics' file cannot be written: {trouble}"
            host.publish_event("metrics_away", Severity.WARNING, text, {})
        else:
            host.publish_event("metrics_back", Severity.INFO, "the metrics' file is written again", {})

    def load() -> Callable[[Site], IntegrationService]:
        module = importlib.import_module("gateway.metrics.service")

        def make(site: Site) -> IntegrationService:
            service = module.MetricsService(
                metrics_settings_of(site),
                source,
                host.clock,
                verbs=VERBS,
                on_trouble=note_trouble,
                in_thread=in_thread,
            )
            return RunningMetrics(service, site, export)

        return make

    return Integration(
        "metrics",
        host,
        is_wanted=lambda each: each.config.metrics is not None,
        load=load,
        missing=NOT_INSTALLED,
    )


def metrics_settings_of(site: Site) -> MetricsSettings:
    """Return what the metrics run by."""
    table = site.config.metrics
    if table is None:
        return MetricsSettings()
    file = None if table.textfile is None else site.folder / table.textfile
    return MetricsSettings(has_all_points=table.all_points, textfile=file)
