"""What discovery depends on beside a starter's `info`, in plain values; and the names made of it.

A name in Home Assistant has only `[a-zA-Z0-9_-]`. Ours have no capitals, so a capital marks where a name
ends: no two starters of any gateways can meet in one name.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from gateway.contract import Topics
from gateway.starters.policy.rights import Rights

STOP, START, RESET = "stop", "start", "reset"


@dataclass(frozen=True, slots=True)
class StarterFacts:
    """What the configuration and the family say of one starter."""

    title: str  # of its family: maker and type
    thermal_point: str = ""  # the load of its thermal model; empty where there is none
    two_step: frozenset[str] = frozenset()  # verbs that need a selection first, which a button cannot make


@dataclass(frozen=True, slots=True)
class SiteFacts:
    """What the configuration says; `client` is Home Assistant's level in command topics."""

    gateway: str
    base: str
    version: str  # of this program
    discovery_prefix: str
    birth_topic: str
    starters: Mapping[str, StarterFacts]
    lines: tuple[str, ...] = ()
    client: str | None = None  # None: Home Assistant gives no commands
    has_start: bool = False  # start and reset too
    page_url: str | None = None
    rights: Rights = field(default_factory=Rights)

    @property
    def topics(self) -> Topics:
        """Return the gateway's topics."""
        return Topics(self.base)

    @property
    def gateway_id(self) -> str:
        """Return the gateway's name in Home Assistant."""
        return f"sg_{self.gateway.replace('_', '_U')}"

    def object_id(self, starter: str) -> str:
        """Return a starter's name in Home Assistant; the gateway's own for an empty name."""
        return f"{self.gateway_id}_{starter}" if starter else self.gateway_id

    def config_topic(self, starter: str) -> str:
        """Return the topic of a starter's discovery; the gateway's own for an empty name."""
        return f"{self.discovery_prefix}/device/{self.object_id(starter)}/config"

    def verbs(self, starter: str) -> tuple[str, ...]:
        """Return what Home Assistant gets a button for: what it may do, and a button can do."""
        client = self.client
        if client is None:
            return ()
        wanted = (STOP, START, RESET) if self.has_start else (STOP,)
        return tuple(
            verb
            for verb in wanted
            if self.rights.is_allowed(client, verb=verb, starter=starter)
            and verb not in self.starters[starter].two_step
        )
