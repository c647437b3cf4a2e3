"""Sparkplug B: what the edge node of a site runs by, and its service, which needs the extra."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

from gateway.config import SparkplugTable, broker_of, rights_of
from gateway.contract import EventCode, Severity, event_of
from gateway.mqtt import BrokerSettings
from gateway.plugins.interface import Gateway, Plugin, PluginSite
from gateway.plugins.sparkplug.settings import SparkplugSettings

MISSING = event_of(EventCode.SPARKPLUG_AWAY, "missing", severity=Severity.ERROR)
LARGEST_PACKET = 8192  # bytes: what a host may ask has half of it, topic and properties the rest


def load(gateway: Gateway) -> Callable[[SparkplugSettings], Plugin]:
    """Import what Sparkplug needs, and return what makes an edge node."""
    module: Any = importlib.import_module("gateway.plugins.sparkplug.service")
    return lambda settings: module.SparkplugService(settings, gateway)


def settings_of(site: PluginSite) -> SparkplugSettings | None:
    """Return what the edge node of a site runs by; None while it is none."""
    config, table = site.config, site.config.sparkplug
    if table is None:
        return None
    return SparkplugSettings(
        table=table,
        node=table.node or config.gateway.name,
        servers=tuple(_servers(site, table)),
        starters=tuple(starter.name for starter in config.starters),
        lines=tuple(line.name for line in config.lines),
        rights=tuple(each for each in rights_of(config).operators if each.client == table.operator),
    )


def _servers(site: PluginSite, table: SparkplugTable) -> Iterable[BrokerSettings]:
    """Yield the ways to the servers in `urls`, with this table's login and files, or to that of `[mqtt]`."""
    mqtt = site.config.mqtt
    login = table.model_dump(include={"username", "ca_file", "cert_file", "key_file"}) if table.urls else {}
    own = {**login, "version": table.mqtt_version, "keepalive_s": table.keepalive_s}
    for url in table.urls or (mqtt.url,):
        server = mqtt.model_copy(update={**own, "url": url})
        settings = broker_of(
            server,
            site.folder,
            client_id=f"{site.config.client_id}-spb",
            username=server.username,
            password=site.secrets["sparkplug" if table.urls else "mqtt"],
        )
        yield replace(settings, largest_packet=LARGEST_PACKET)
