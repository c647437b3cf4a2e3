"""Sparkplug B's topics for one edge node; pure."""

from __future__ import annotations

from dataclasses import dataclass

NAMESPACE = "spBv1.0"
REBIRTH = "Node Control/Rebirth"
BD_SEQ = "bdSeq"
SEQ_NUMBERS = 256  # of `seq` and `bdSeq`: 0 to 255 [tck-id-payloads-sequence-num-incrementing]


@dataclass(frozen=True, slots=True)
class EdgeTopics:
    """Of one group and edge node; a device is a starter."""

    group: str
    node: str

    @property
    def node_command(self) -> str:
        """Return where hosts command the node."""
        return self.of("NCMD")

    @property
    def device_commands(self) -> str:
        """Return the filter of what hosts command the devices."""
        return f"{self.of('DCMD')}/+"

    def of(self, kind: str, device: str | None = None) -> str:
        """Return the topic of a kind of message."""
        topic = f"{NAMESPACE}/{self.group}/{kind}/{self.node}"
        return topic if device is None else f"{topic}/{device}"

    def commanded_device(self, topic: str) -> str | None:
        """Return which device a topic commands; None for every other topic."""
        start = f"{self.of('DCMD')}/"
        device = topic.removeprefix(start)
        return device if topic.startswith(start) and device and "/" not in device else None


def state_topic(host: str) -> str:
    """Return where a host application says whether it is online."""
    return f"{NAMESPACE}/STATE/{host}"
