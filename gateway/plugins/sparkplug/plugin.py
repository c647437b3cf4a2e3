"""Sparkplug B: the edge node of a site, made anew whenever the configuration of it is another one."""

from __future__ import annotations

import asyncio
import importlib
import platform
import secrets
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any

from gateway import __version__
from gateway.config.convert import rights_of, tls_of, version_of
from gateway.config.integration_tables import SparkplugTable
from gateway.config.schema import Config
from gateway.config.values import SCHEMES, split_url
from gateway.contract import EventCode, Record, Severity, event_of
from gateway.mqtt.connection.settings import BrokerSettings
from gateway.plugins.interface import Gateway, Plugin, PluginSite
from gateway.plugins.sparkplug.settings import SparkplugSettings
from gateway.storage.json_file import JsonFile
from gateway.system.supervised import until_first

if TYPE_CHECKING:
    from gateway.plugins.sparkplug.service import SparkplugLink, SparkplugParts

NAME = "sparkplug"
MISSING = event_of(EventCode.SPARKPLUG_AWAY, "missing", severity=Severity.ERROR)
FOLDER, NUMBERS_FILE = "sparkplug", "bdseq.json"  # in state_dir
LARGEST_PACKET = 8192  # bytes: what a host may ask has half of it, topic and properties the rest


class SparkplugService:
    """Implements `Plugin`; `module` is `gateway.plugins.sparkplug.service`, which needs the extra."""

    def __init__(self, site: PluginSite, module: Any, parts: SparkplugParts, *, seed: int) -> None:
        self._module = module
        self._parts = parts
        self._seed = seed
        self._changed = asyncio.Event()
        self._site = site
        self._settings = node_settings_of(site, seed=seed)
        self._link = self._made()

    def put(self, record: Record) -> None:
        """Take a record, in order."""
        self._link.put(record)

    def reconfigure(self, site: PluginSite) -> None:
        """Follow another configuration: with other settings as another node, else as the same."""
        self._site = site
        settings = node_settings_of(site, seed=self._seed)
        if settings == self._settings:
            self._link.follow(*_names(site.config))
            return
        self._settings = settings
        self._changed.set()

    async def run(self) -> None:
        """Serve until cancelled, then die in order."""
        while True:
            self._changed.clear()
            await until_first(self._link.run(), self._changed.wait())
            self._link = self._made()

    def _made(self) -> SparkplugLink:
        config = self._site.config
        starters, lines = _names(config)
        link: SparkplugLink = self._module.sparkplug_link(
            self._settings,
            self._parts,
            starters=starters,
            lines=lines,
            properties=_properties(),
            store=JsonFile(self._site.state_dir / FOLDER / NUMBERS_FILE),
        )
        return link


def load(gateway: Gateway) -> Callable[[PluginSite], Plugin]:
    """Import what Sparkplug needs, and return what makes an edge node."""
    module = importlib.import_module("gateway.plugins.sparkplug.service")
    seed = secrets.randbits(32)
    parts = module.SparkplugParts(
        latest=gateway.latest.records,
        clock=gateway.clock,
        commands=gateway.commands,
        facts=gateway.mqtt.facts,
        publish_event=gateway.publish_event,
        since_s=gateway.started_s,
    )
    return lambda present: SparkplugService(present, module, parts, seed=seed)


def settings_of(site: PluginSite) -> PluginSite | None:
    """Return the site while it is an edge node."""
    return None if site.config.sparkplug is None else site


def node_settings_of(site: PluginSite, *, seed: int) -> SparkplugSettings:
    """Return what the edge node of a site runs by."""
    table = site.config.sparkplug
    if table is None:
        raise ValueError("there is no [sparkplug]")
    return SparkplugSettings(
        group=table.group,
        node=table.node or site.config.gateway.name,
        servers=tuple(_servers(site, table, seed)),
        primary_host=table.primary_host,
        operator=table.operator if table.commands else None,
        rights=tuple(each for each in rights_of(site.config).operators if each.client == table.operator),
        ttl_s=table.ttl_s,
        has_datatypes=table.datatypes_in_data,
    )


def _servers(site: PluginSite, table: SparkplugTable, seed: int) -> Iterable[BrokerSettings]:
    mqtt = site.config.mqtt
    is_own = bool(table.urls)
    tls = tls_of(table if is_own else mqtt, site.folder)
    for url in table.urls or (mqtt.url,):
        parts = split_url(url)
        if parts is None:
            continue  # the configuration has been checked
        split, port = parts
        yield BrokerSettings(
            host=split.hostname or "",
            port=port,
            client_id=f"{site.config.client_id}-spb",
            username=table.username if is_own else mqtt.username,
            password=site.sparkplug_password,
            tls=tls if SCHEMES[split.scheme] == SCHEMES["mqtts"] else None,
            version=version_of(table.mqtt_version),
            keepalive_s=table.keepalive_s,
            largest_packet=LARGEST_PACKET,
            seed=seed,
        )


def _names(config: Config) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the starters' and the lines' names."""
    return tuple(starter.name for starter in config.starters), tuple(line.name for line in config.lines)


def _properties() -> dict[str, str]:
    return {
        "Properties/Software": "starter-gateway",
        "Properties/Version": __version__,
        "Properties/Hardware Make": platform.machine(),
        "Properties/OS": platform.system(),
        "Properties/OS Version": platform.release(),
    }
