"""The metrics for Prometheus: what they read of the gateway."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import get_args

from gateway import __version__
from gateway.config.schema import Verb
from gateway.contract import CONTRACT_VERSION, EventCode, Severity, event_of
from gateway.families import Profile, once_per_profile, unnumbered
from gateway.plugins.interface import Gateway, Plugin, PluginSite
from gateway.plugins.metrics.scrape import (
    MetricsSettings,
    ScrapedGateway,
    ScrapedLine,
    ScrapedStarter,
)

MISSING = event_of(EventCode.METRICS_AWAY, "missing", severity=Severity.ERROR)
VERBS = frozenset(get_args(Verb)) - {"*"}


@once_per_profile
def fault_codes(profile: Profile) -> tuple[str, ...]:
    """Return the codes that trips of a family have: those that it names, and that without a number."""
    codes = [each.code for each in profile.alarms if each.severity == "fault"]
    return (*codes, unnumbered(profile, "fault").code)


@dataclass(frozen=True)
class GatewaySource:
    """Implements `MetricsSource`: gathers references, and asks no line. On the application's loop."""

    gateway: Gateway

    def scraped(self) -> ScrapedGateway:
        """Return how everything is now."""
        gateway, page = self.gateway, self.gateway.plugin("web")
        return ScrapedGateway(
            name=gateway.name,
            version=__version__,
            contract=CONTRACT_VERSION,
            now_s=gateway.clock.utc_s(),
            started_s=gateway.started_s,
            is_connected=gateway.mqtt.is_connected(),
            outbox=gateway.mqtt.statistics(),
            is_clock_synchronised=gateway.clock_doubt() is None,
            streams=None if page is None else getattr(page, "streams", None),
            loops={name: meter.delays.taken() for name, meter in gateway.loops.items()},
            lines=tuple(ScrapedLine(name, line.statistics()) for name, line in gateway.lines().items()),
            starters=tuple(self._starter(name) for name in gateway.starters),
        )

    def _starter(self, name: str) -> ScrapedStarter:
        starter = self.gateway.starters[name]
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
            is_locked=self.gateway.policy.motor_history.lock_of(name) is not None,
            state=starter.state,
            readings=starter.snapshot.readings,
            fault_codes=fault_codes(starter.profile),
        )


def load(gateway: Gateway) -> Callable[[MetricsSettings], Plugin]:
    """Import what metrics need, and return what makes them."""

    def note_trouble(trouble: str) -> None:
        if trouble:
            gateway.publish_event(
                EventCode.METRICS_AWAY, "trouble", severity=Severity.WARNING, trouble=trouble
            )
        else:
            gateway.publish_event(EventCode.METRICS_BACK)

    module = importlib.import_module("gateway.plugins.metrics.service")
    return partial(
        module.MetricsService,
        source=GatewaySource(gateway),
        clock=gateway.clock,
        verbs=VERBS,
        on_trouble=note_trouble,
        in_thread=gateway.in_thread,
    )


def settings_of(site: PluginSite) -> MetricsSettings | None:
    """Return what the metrics run by."""
    table = site.config.metrics
    if table is None:
        return None
    file = None if table.textfile is None else site.folder / table.textfile
    return MetricsSettings(table.all_points, file, site.metrics_token)
