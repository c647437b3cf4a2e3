"""The edge node of a site: its table, its topics, and the configuration that concerns it; pure."""

from __future__ import annotations

from dataclasses import dataclass

from gateway.config import SparkplugTable
from gateway.contract import Operator
from gateway.mqtt import BrokerSettings

NAMESPACE = "spBv1.0"
REBIRTH = "Node Control/Rebirth"
BD_SEQ = "bdSeq"
SEQ_NUMBERS = 256  # of `seq` and `bdSeq`: 0 to 255 [tck-id-payloads-sequence-num-incrementing]


@dataclass(frozen=True, slots=True)
class SparkplugSettings:
    """One edge node, whose devices are starters; `servers` are tried one after the other."""

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

    def topic(self, kind: str, device: str | None = None) -> str:
        """Return the topic of a kind of message, of the node or of a device."""
        topic = f"{NAMESPACE}/{self.table.group}/{kind}/{self.node}"
        return topic if device is None else f"{topic}/{device}"

    def commanded_device(self, topic: str) -> str | None:
        """Return which device a topic commands; None for every other topic."""
        start, _, device = topic.rpartition("/")
        return device if device and start == self.topic("DCMD") else None


def state_topic(host: str) -> str:
    """Return where a host application says whether it is online."""
    return f"{NAMESPACE}/STATE/{host}"
