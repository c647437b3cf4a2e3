"""Converts the configuration to the plain values that the lower layers take."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from gateway.config.integration_tables import MqttTable
from gateway.config.schema import Config, LineTable, RulesTable, StarterTable
from gateway.contract import Operator
from gateway.families import ENGLISH, Variant
from gateway.line import WiredStarter
from gateway.modbus import Framing, LineTiming
from gateway.mqtt import BrokerSettings, TlsSettings, Version
from gateway.starters import PolicySettings, Rights, RuleSet, StarterSetup


def timing_of(line: LineTable) -> LineTiming:
    """Return the times of a line."""
    return LineTiming(line.baud, Framing.parse(line.framing))


def setups_of(line: LineTable, language: str = ENGLISH) -> tuple[StarterSetup, ...]:
    """Return the starters of a line, the disabled ones too, with the names of their family in a language."""
    on_line = partial(
        StarterSetup, line=line.name, timing=timing_of(line), allowance_s=line.adapter_allowance_s
    )
    return tuple(
        on_line(
            name=starter.name,
            title=starter.title,
            address=starter.address,
            profile=starter.profile(language),
            variant=Variant(model=starter.model, slot=starter.slot),
            every_s=starter.every_s,
            response_time_s=starter.response_time_s,
            is_enabled=starter.enabled,
            watchdog_s=starter.watchdog_s,
        )
        for starter in line.starters
    )


def wired_starters(line: LineTable) -> tuple[WiredStarter, ...]:
    """Return the starters of a line as its cable passes them, without the disabled ones."""
    places = {name: place for place, name in enumerate(line.order or ())}
    enabled = (setup for setup in setups_of(line) if setup.is_enabled)
    setups = sorted(enabled, key=lambda setup: (places.get(setup.name, 0), setup.address))
    return tuple(
        WiredStarter(setup.name, setup.address, setup.response_time_s or setup.profile.timing.read_s)
        for setup in setups
    )


def setups_in(config: Config) -> list[StarterSetup]:
    """Return the starters of all lines."""
    return [setup for line in config.lines for setup in setups_of(line)]


def wiring_of(config: Config) -> dict[str, tuple[WiredStarter, ...]]:
    """Return by line its starters as the cable passes them, without the disabled ones."""
    return {line.name: wired_starters(line) for line in config.lines}


def rights_of(config: Config) -> Rights:
    """Return who may do what."""
    return Rights(Operator(each.client, each.may, each.starters, each.freshness) for each in config.operators)


def policy_of(config: Config) -> PolicySettings:
    """Return what is demanded of commands, and which starters stop together."""
    groups = {
        group.name: tuple(each.name for each in config.starters if each.is_among(group.starters))
        for group in config.groups
    }
    return PolicySettings({each.name: rules_of(config, each) for each in config.starters}, groups)


def rules_of(config: Config, starter: StarterTable) -> RuleSet:
    """Return the rules of a starter, key by key: its own, else those of the last table that names it."""
    shared = [table for table in config.rules if starter.is_among(table.starters)]
    tables: list[RulesTable] = [*shared, starter.rules or RulesTable()]
    given = {
        name: value
        for table in tables
        for name in RulesTable.model_fields
        if (value := getattr(table, name)) is not None
    }
    return RuleSet(**{**given, "two_step": frozenset(given.get("two_step", ()))})


def least_watchdog_s(config: Config) -> float | None:
    """Return the shortest watchdog that is stated of an enabled starter; None when none is."""
    limits_s = (each.watchdog_s for each in config.starters if each.enabled and each.watchdog_s)
    return min(limits_s, default=None)


def broker_of(
    mqtt: MqttTable, folder: Path, *, client_id: str, username: str | None, password: str | None
) -> BrokerSettings:
    """Return the way to a broker as this client and login; `folder` is the configuration's."""
    files = (mqtt.ca_file, mqtt.cert_file, mqtt.key_file)
    paths = [None if file is None else str(folder / file) for file in files]
    return BrokerSettings(
        host=mqtt.host,
        port=mqtt.port,
        client_id=client_id,
        username=username,
        password=password,
        tls=TlsSettings(*paths) if mqtt.is_tls else None,
        version=None if mqtt.version == "auto" else Version(mqtt.version),
        keepalive_s=mqtt.keepalive_s,
    )
