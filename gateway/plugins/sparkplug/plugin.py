"""Sparkplug B: what the edge node of a site runs by, and its service, which needs the extra."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterable
from typing import Any

from gateway.config.convert import rights_of, tls_of, version_of
from gateway.config.integration_tables import SparkplugTable
from gateway.config.values import SCHEMES, split_url
from gateway.contract import EventCode, Severity, event_of
from gateway.mqtt.connection.settings import BrokerSettings
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
        group=table.group,
        node=table.node or config.gateway.name,
        servers=tuple(_servers(site, table)),
        starters=tuple(starter.name for starter in config.starters),
        lines=tuple(line.name for line in config.lines),
        primary_host=table.primary_host,
        operator=table.operator if table.commands else None,
        rights=tuple(each for each in rights_of(config).operators if each.client == table.operator),
        ttl_s=table.ttl_s,
        has_datatypes=table.datatypes_in_data,
    )


def _servers(site: PluginSite, table: SparkplugTable) -> Iterable[BrokerSettings]:
    mqtt = site.config.mqtt
    login = table if table.urls else mqtt
    for url in table.urls or (mqtt.url,):
        parts = split_url(url)
        if parts is None:
            continue  # the configuration has been checked
        split, port = parts
        yield BrokerSettings(
            host=split.hostname or "",
            port=port,
            client_id=f"{site.config.client_id}-spb",
            username=login.username,
            password=site.sparkplug_password,
            tls=tls_of(login, site.folder) if SCHEMES[split.scheme] == SCHEMES["mqtts"] else None,
            version=version_of(table.mqtt_version),
            keepalive_s=table.keepalive_s,
            largest_packet=LARGEST_PACKET,
        )
