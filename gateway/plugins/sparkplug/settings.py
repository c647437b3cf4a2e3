"""The settings of the edge node: its table, and the other parts of the configuration that concern it."""

from __future__ import annotations

from dataclasses import dataclass

from gateway.config import SparkplugTable
from gateway.contract import Operator
from gateway.mqtt import BrokerSettings
from gateway.plugins.sparkplug.topics import EdgeTopics


@dataclass(frozen=True, slots=True)
class SparkplugSettings:
    """One edge node; `servers` are tried one after the other."""

    table: SparkplugTable
    node: str  # its id
    servers: tuple[BrokerSettings, ...]
    starters: tuple[str, ...]
    lines: tuple[str, ...]
    rights: tuple[Operator, ...]  # of the table's operator

    @property
    def operator(self) -> str | None:
        """Return whose rights commands have; None: none are taken."""
        return self.table.operator if self.table.commands else None

    @property
    def topics(self) -> EdgeTopics:
        """Return the node's topics."""
        return EdgeTopics(self.table.group, self.node)
