"""The metrics for Prometheus: what they read of the gateway."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import get_args

from gateway import __version__
from gateway.app.integrations.integration import Integration, IntegrationHost, IntegrationService
from gateway.app.plant import Plant
from gateway.app.site import Site
from gateway.config.schema import Verb
from gateway.contract import CONTRACT_VERSION, EventCode, LockRecord, Severity, event_of
from gateway.families.devices.device import unnumbered
from gateway.families.profile.schema import Profile, once_per_profile
from gateway.metrics.scrape import (
    MetricsSettings,
    MetricsSource,
    ScrapedGateway,
    ScrapedLine,
    ScrapedStarter,
)
from gateway.mqtt.outbox.outbox import Outbox
from gateway.system.clock import Clock
from gateway.system.stalls import LagMeter

NOT_INSTALLED = event_of(EventCode.METRICS_AWAY, "missing", severity=Severity.ERROR)
VERBS = frozenset(get_args(Verb)) - {"*"}


@once_per_profile
def fault_codes(profile: Profile) -> tuple[str, ...]:
    """Return the codes that trips of a family have: those that it names, and that without a number."""
    codes = [each.code for each in profile.alarms if each.severity == "fault"]
    return (*codes, unnumbered(profile, "fault").code)


@dataclass(frozen=True, kw_only=True)
class GatewaySource:
    """Implements `MetricsSource`: gathers references, and asks no line. On the application's loop."""

    name: str
    plant: Plant
    outbox: Outbox
    clock: Clock
    started_s: float  # UTC
    clock_doubt: Callable[[], str | None]
    lock_of: Callable[[str], LockRecord | None]
    loops: Mapping[str, LagMeter]
    streams: Callable[[], int | None]

    def scraped(self) -> ScrapedGateway:
        """Return how everything is now."""
        return ScrapedGateway(
            name=self.name,
            version=__version__,
            contract=CONTRACT_VERSION,
            now_s=self.clock.utc_s(),
            started_s=self.started_s,
            is_connected=self.outbox.is_connected,
            outbox=self.outbox.statistics(self.clock.now_s()),
            is_clock_synchronised=self.clock_doubt() is None,
            streams=self.streams(),
            loops={name: meter.delays.taken() for name, meter in self.loops.items()},
            lines=tuple(ScrapedLine(name, line.statistics()) for name, line in self.plant.lines.items()),
            starters=tuple(self._starter(name) for name in self.plant.starters),
        )

    def _starter(self, name: str) -> ScrapedStarter:
        starter = self.plant.starters[name]
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
            is_locked=self.lock_of(name) is not None,
            state=starter.state,
            readings=starter.snapshot.readings,
            fault_codes=fault_codes(starter.profile),
        )


def metrics_integration(host: IntegrationHost, source: MetricsSource) -> Integration:
    """Return the metrics, which run while the configuration has a `[metrics]`."""

    def note_trouble(trouble: str) -> None:
        if trouble:
            host.publish_event(EventCode.METRICS_AWAY, "trouble", severity=Severity.WARNING, trouble=trouble)
        else:
            host.publish_event(EventCode.METRICS_BACK)

    def load() -> Callable[[MetricsSettings], IntegrationService]:
        module = importlib.import_module("gateway.metrics.service")
        return partial(
            module.MetricsService,
            source=source,
            clock=host.clock,
            verbs=VERBS,
            on_trouble=note_trouble,
            in_thread=host.in_thread,
        )

    return Integration(
        "metrics",
        host,
        is_wanted=lambda each: each.config.metrics is not None,
        load=load,
        missing=NOT_INSTALLED,
        settings_of=metrics_settings_of,
    )


def metrics_settings_of(site: Site) -> MetricsSettings:
    """Return what the metrics run by."""
    table = site.config.metrics
    if table is None:
        return MetricsSettings()
    file = None if table.textfile is None else site.folder / table.textfile
    return MetricsSettings(table.all_points, file, site.metrics_token)
