"""What the gateway announces of a starter of each family."""

from __future__ import annotations

import json
from typing import Any

from gateway.config.convert import setups_of
from gateway.config.reading import parse
from gateway.config.schema import Config
from gateway.families.devices.device import Identity
from gateway.plugins.homeassistant.discovery import gateway_message, starter_message
from gateway.plugins.homeassistant.site_facts import SiteFacts, facts_of
from gateway.starters.description import info_of

STARTERS = {"pump-1": "ssw07", "fan": "ssw06", "mill": "ssw900", "belt": "sst"}
TABLE = '[homeassistant]\noperator = "home-assistant"\ncommands = true\n'
OPERATOR = '[[operator]]\nclient = "home-assistant"\nmay = ["start", "stop", "reset"]\nstarters = ["*"]\n'


def config(
    table: str = TABLE,
    *,
    base: str = "starters/{gateway}",
    operator: str = OPERATOR,
    more: str = "",
    gateway: str = "mcc1",
) -> Config:
    starters = "".join(
        f'[[line.starter]]\nname = "{name}"\naddress = {place}\nfamily = "{family}"\n'
        for place, (name, family) in enumerate(STARTERS.items(), 1)
    )
    head = f'[gateway]\nname = "{gateway}"\n[mqtt]\nurl = "mqtt://127.0.0.1"\nbase = "{base}"\n'
    line = '[[line]]\nname = "hall"\nport = "/dev/hall"\nbaud = 19200\nframing = "8N2"\n'
    return parse(head + table + operator + line + starters + more, "site.toml")


def facts(*arguments: str, **options: Any) -> SiteFacts:
    found = facts_of(config(*arguments, **options))
    assert found is not None
    return found


def announced(*arguments: str, **options: Any) -> dict[str, dict[str, Any]]:
    """Return the discovery of each starter before it has answered, and of the gateway under an empty name."""
    site, said = config(*arguments, **options), facts(*arguments, **options)
    setups = [setup for line in site.lines for setup in setups_of(line)]
    infos = {setup.name: info_of(setup, setup.variant, Identity()) for setup in setups}
    found = {name: starter_message(said, info) for name, info in infos.items()}
    return {name: json.loads(each.payload) for name, each in {**found, "": gateway_message(said)}.items()}
