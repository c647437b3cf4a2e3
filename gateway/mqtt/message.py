"""A message of MQTT, and the one that a record makes."""

from __future__ import annotations

from typing import NamedTuple

from gateway.contract import Record, ResultRecord

MAX_HISTORY_ITEMS = 200  # in one message
FIRST_FAILURE = 0x80  # the broker's reason codes from here on are refusals [MQTT5 2.4]


class Message(NamedTuple):
    """One publication; a retained one is replaced by the next one of its topic, any other is queued."""

    topic: str
    payload: bytes
    qos: int
    retain: bool
    correlation: bytes | None = None  # MQTT 5 only
    record: Record | None = None  # None: of an integration, or one that clears its topic

    @property
    def source(self) -> Record | Message:
        """Return what the same message can be made of again, of which others hold the record anyway."""
        return self if self.record is None else self.record

    @property
    def key(self) -> str:
        """Return what names a message that must be published once; empty for any other."""
        return "" if self.record is None else self.record.key

    @property
    def packet_size(self) -> int:
        """Return the size of the PUBLISH packet, at most [MQTT5 3.3]."""
        return 20 + len(self.topic) + len(self.payload) + len(self.correlation or b"")


def message_of(record: Record, base: str) -> Message:
    """Return a record as it is published below a base."""
    return message_at(f"{base}/{record.topic}", record)


def message_at(topic: str, source: Record | Message) -> Message:
    """Return the message of a topic whose source is known."""
    if isinstance(source, Message):
        return source
    correlation = source.correlation if isinstance(source, ResultRecord) else None
    return Message(topic, source.payload(), source.QOS, source.RETAIN, correlation, source)


def cleared(topic: str) -> Message:
    """Return the message that makes the broker forget a retained topic."""
    return Message(topic, b"", qos=1, retain=True)
