"""The facts for discovery beside a starter's `info`: the configuration; and the names made of it.

A name in Home Assistant has only `[a-zA-Z0-9_-]`. Ours have no capitals, so a capital marks where a name
ends: no two starters of any gateways can meet in one name.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from gateway.config import Config, HomeAssistantTable, policy_of, rights_of
from gateway.contract import STOP, Topics
from gateway.starters import Rights, RuleSet


@dataclass(frozen=True, slots=True)
class SiteFacts:
    """The configuration with its table, and by what commands are judged: `rules` of each starter."""

    config: Config
    table: HomeAssistantTable
    rights: Rights
    rules: Mapping[str, RuleSet]

    @property
    def topics(self) -> Topics:
        """Return the gateway's topics."""
        return Topics(self.config.base)

    @property
    def birth_topic(self) -> str:
        """Return where Home Assistant says that it has begun."""
        return self.table.birth_topic or f"{self.table.discovery_prefix}/status"

    @property
    def gateway_id(self) -> str:
        """Return the gateway's name in Home Assistant."""
        return f"sg_{self.config.gateway.name.replace('_', '_U')}"

    def object_id(self, starter: str) -> str:
        """Return a starter's name in Home Assistant; the gateway's own for an empty name."""
        return f"{self.gateway_id}_{starter}" if starter else self.gateway_id

    def config_topic(self, starter: str) -> str:
        """Return the topic of a starter's discovery; the gateway's own for an empty name."""
        return f"{self.table.discovery_prefix}/device/{self.object_id(starter)}/config"

    @property
    def client(self) -> str:
        """Return Home Assistant's level in the topics of commands; empty: it gives none."""
        return self.table.operator or ""

    def verbs(self, starter: str, buttons: Iterable[str]) -> list[str]:
        """Return which of the buttons there are: what it is to do, may do, and can do by one press."""
        return [
            verb
            for verb in buttons
            if (self.table.commands or verb == STOP)
            and self.rights.is_allowed(self.client, verb=verb, starter=starter)
            and verb not in self.rules[starter].two_step
        ]


def facts_of(config: Config) -> SiteFacts | None:
    """Return what discovery depends on; None without a `[homeassistant]`."""
    table = config.home_assistant
    return None if table is None else SiteFacts(config, table, rights_of(config), policy_of(config).rules)
