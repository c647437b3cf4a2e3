"""Converts the configuration to the plain values that the lower layers take."""

from __future__ import annotations

import fnmatch
from pathlib import Path

from gateway.config.schema import Config, LineTable, RulesTable, StarterTable
from gateway.families.profile.load import load_profile
from gateway.families.profile.schema import Variant
from gateway.modbus.timing import Framing, LineTiming
from gateway.starters.policy.rights import Operator, Rights
from gateway.starters.policy.start_rules import PolicySettings, RuleSet
from gateway.starters.setup import StarterSetup


def timing_of(line: LineTable) -> LineTiming:
    """Return the times of a line."""
    return LineTiming(line.baud, Framing.parse(line.framing))


def setups_of(line: LineTable) -> tuple[StarterSetup, ...]:
    """Return the starters of a line, the disabled ones too."""
    return tuple(_setup(line, starter) for starter in line.starters)


def rights_of(config: Config) -> Rights:
    """Return who may do what."""
    return Rights(Operator(each.client, each.may, each.starters, each.freshness) for each in config.operators)


def policy_of(config: Config) -> PolicySettings:
    """Return what is demanded of commands, and which starters stop together."""
    starters = [starter for line in config.lines for starter in line.starters]
    return PolicySettings(
        rules={starter.name: _rules(config, starter) for starter in starters},
        groups={
            group.name: tuple(starter.name for starter in starters if _is_among(starter, group.starters))
            for group in config.groups
        },
    )


def least_watchdog_s(config: Config) -> float | None:
    """Return the shortest watchdog that is stated of an enabled starter; None when none is."""
    starters = (each for line in config.lines for each in line.starters if each.enabled)
    return min((each.watchdog_s for each in starters if each.watchdog_s), default=None)


def tls_files_of(config: Config, folder: Path) -> tuple[str | None, str | None, str | None]:
    """Return the paths of `ca_file`, `cert_file` and `key_file`; `folder` is the configuration's."""
    mqtt = config.mqtt
    ca, cert, key = (
        None if name is None else str(folder / name) for name in (mqtt.ca_file, mqtt.cert_file, mqtt.key_file)
    )
    return ca, cert, key


def _rules(config: Config, starter: StarterTable) -> RuleSet:
    """Return the rules of a starter, key by key: its own, else those of the last table that names it."""
    shared = [table for table in config.rules if _is_among(starter, table.starters)]
    tables: list[RulesTable] = [*shared, starter.rules or RulesTable()]
    given = {
        name: value
        for table in tables
        for name, value in table.model_dump(exclude={"starters"}, exclude_none=True).items()
    }
    return RuleSet(**{**given, "two_step": frozenset(given.get("two_step", ()))})


def _is_among(starter: StarterTable, patterns: tuple[str, ...]) -> bool:
    return any(fnmatch.fnmatchcase(starter.name, pattern) for pattern in patterns)


def _setup(line: LineTable, starter: StarterTable) -> StarterSetup:
    return StarterSetup(
        name=starter.name,
        line=line.name,
        address=starter.address,
        profile=load_profile(starter.family),
        variant=Variant.model_validate({"model": starter.model, "slot": starter.slot}),
        every_s=starter.every_s,
        response_time_s=starter.response_time_s,
        is_enabled=starter.enabled,
        watchdog_s=starter.watchdog_s,
        learns_response_times=line.learn_response_times,
        timing=timing_of(line),
        allowance_s=line.adapter_allowance_s,
        has_fast_words=starter.fast_words,
    )
