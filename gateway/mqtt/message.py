"""A message of MQTT, and the one that a record makes."""

from __future__ import annotations

from typing import NamedTuple

from gateway.contract import Record, ResultRecord, ValueRecord

MAX_HISTORY_ITEMS = 200  # in one message


class Message(NamedTuple):
    """One publication; a retained one is replaced by the next one of its topic, any other is queued."""

    topic: str
    payload: bytes
    qos: int
    retain: bool
    is_droppable: bool = False  # goes first when the outbox is full
    correlation: bytes | None = None  # MQTT 5 only
    value: ValueRecord | None = None  # published late when a newer one replaces it before it was sent
    key: str = ""  # names what must be published once: a final result ("client/id"), a start or a trip

    @property
    def packet_size(self) -> int:
        """Return the size of the PUBLISH packet, at most [MQTT5 3.3]."""
        return 20 + len(self.topic) + len(self.payload) + len(self.correlation or b"")


def message_of(record: Record, base: str) -> Message:
    """Return a record as it is published below a base."""
    return Message(
        f"{base}/{record.topic}",
        record.payload(),
        qos=record.QOS,
        retain=record.RETAIN,
        is_droppable=record.IS_DROPPABLE,
        correlation=record.correlation if isinstance(record, ResultRecord) else None,
        value=record if isinstance(record, ValueRecord) else None,
        key=record.key,
    )


def cleared(topic: str) -> Message:
    """Return the message that makes the broker forget a retained topic."""
    return Message(topic, b"", qos=1, retain=True)
