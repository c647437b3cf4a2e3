"""What the edge node runs by, as plain values."""

from __future__ import annotations

from dataclasses import dataclass

from gateway.contract import Operator
from gateway.mqtt.connection.settings import BrokerSettings
from gateway.plugins.sparkplug.topics import EdgeTopics


@dataclass(frozen=True, slots=True)
class SparkplugSettings:
    """One edge node; `servers` are tried one after the other."""

    group: str
    node: str
    servers: tuple[BrokerSettings, ...]
    starters: tuple[str, ...] = ()
    lines: tuple[str, ...] = ()
    primary_host: str | None = None
    operator: str | None = None  # whose rights commands have; None: none are taken
    rights: tuple[Operator, ...] = ()  # of that operator
    ttl_s: float = 5.0  # how old a command may be
    has_datatypes: bool = False  # in data messages too

    @property
    def topics(self) -> EdgeTopics:
        """Return the node's topics."""
        return EdgeTopics(self.group, self.node)
