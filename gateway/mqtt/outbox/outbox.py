"""What is still to be published: the newest message of every retained topic, and the queued ones in order.

Retained topics hold only their newest message, and all of them are sent again on every connection. Queued
messages (events, results, audit) are sent in order and stay until the broker has acknowledged them, over any
number of connections. Values that a newer one replaced before they were sent are published late, in batches.

What goes out next (`Outbox.take`), within the broker's window of unacknowledged messages:

1. on a new connection, every retained topic, the gateway's status last;
2. queued results and events; of those from before this connection, at most every second one;
3. retained topics with a new message;
4. the history, within the credit that `grant_history` gives.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

from gateway.contract import HistoryRecord, ValueRecord, history_item
from gateway.mqtt.message import MAX_HISTORY_ITEMS, Message, cleared
from gateway.mqtt.outbox.backlog import Backlog
from gateway.mqtt.outbox.segment import ROW_BYTES, QueuedMessage
from gateway.storage.spool import Kind, Refusal

FIRST_FAILURE = 0x80  # reason codes from here on are refusals [MQTT5 2.4]
MAX_REMEMBERED_REFUSALS = 100


class Outgoing(NamedTuple):
    """A message on its way; `ticket` names it until it is acknowledged."""

    ticket: int
    message: Message
    since_s: float | None  # None: a repetition for a new connection, no news
    entries: tuple[QueuedMessage, ...] = ()  # of the backlog, that it contains


class RefusedPublish(NamedTuple):
    """A publication that the broker would not take; it is not sent again."""

    topic: str
    reason_code: int


class Outbox:
    """The messages of one gateway; lives in memory, does no I/O.

    `last_topic` is sent after all other retained topics of a connection: the gateway's status. `boot` names
    this run, to which the values belong that are published late.
    """

    def __init__(
        self,
        *,
        last_topic: str,
        boot: str = "",
        max_rows: int = 20_000,
        max_bytes: int = 16 * 2**20,
    ) -> None:
        self._last_topic = last_topic
        self.backlog = Backlog(boot=boot, max_rows=max_rows, max_bytes=max_bytes)
        self._latest: dict[str, Message] = {}
        self._waiting: dict[str, float] = {}  # retained topics with news, and since when
        self._opening: deque[str] = deque()  # topics that a new connection still has to send first
        self._held: dict[
            str, tuple[Message, QueuedMessage]
        ] = {}  # newest values that are in the backlog as well
        self._in_flight: dict[int, Outgoing] = {}
        self._window = 0  # 0: not connected
        self._tickets = 0
        self._connections = 0
        self._late_upto = 0  # number of the last entry from before this connection
        self._was_late = False
        self._history_credit = 0
        self.refused = 0
        self.refusals: deque[RefusedPublish] = deque(maxlen=MAX_REMEMBERED_REFUSALS)
        self.on_delivered: Callable[[str], None] = lambda _: None  # called with each key

    @property
    def dropped(self) -> int:
        """Return how many messages and values were dropped: there was no room, or a disk lost them."""
        return self.backlog.dropped

    @property
    def latest(self) -> Mapping[str, Message]:
        """Return the newest message of every retained topic."""
        return self._latest

    @property
    def is_connected(self) -> bool:
        """Return whether messages go out now."""
        return self._window > 0

    def put(self, message: Message, now_s: float) -> None:
        """Take a message; a full outbox drops history first, then events and audit, then results."""
        if message.is_queued:
            self._enqueue(message, now_s)
            return
        before = self._latest.get(message.topic)
        if before is not None and message.topic in self._waiting:
            self._remember(before, self._waiting[message.topic])
        self._latest[message.topic] = message
        if message.qos or self._window:  # QoS 0 while offline: the next connection sends the newest
            self._waiting.setdefault(message.topic, now_s)
        if not self._window:
            self._hold(message, now_s)

    def forget(self, branches: Iterable[str], now_s: float) -> None:
        """Make the broker forget every retained topic below these."""
        below = tuple(f"{branch}/" for branch in branches)
        for topic in [topic for topic in self._latest if topic.startswith(below)]:
            self.put(cleared(topic), now_s)

    def connected(self, window: int) -> None:
        """Begin a connection on which `window` messages may be unacknowledged."""
        self._window = window
        self._connections += 1
        self._opening = deque(topic for topic in self._latest if topic != self._last_topic)
        if self._last_topic in self._latest:
            self._opening.append(self._last_topic)
        self._late_upto = self.backlog.last_number
        self.backlog.on_work()

    def disconnected(self) -> None:
        """End a connection; what was not acknowledged waits again, in its old order."""
        self._window = 0
        self._opening.clear()
        unacknowledged = list(self._in_flight.values())
        self._in_flight.clear()
        self.backlog.give_back_all()
        for sent in unacknowledged:
            if sent.entries or sent.since_s is None:
                continue
            if self._latest[sent.message.topic] is sent.message:
                self._waiting.setdefault(sent.message.topic, sent.since_s)
            else:
                self._remember(sent.message, sent.since_s)
        for topic, since_s in self._waiting.items():
            self._hold(self._latest[topic], since_s)

    def take(self) -> Outgoing | None:
        """Return the next message to publish now, or None when there is none or the window is full."""
        if len(self._in_flight) >= self._window:
            return None
        taken = self._take_latest(self._opening) if self._opening else self._take_backlog()
        if taken is None:
            taken = self._take_latest(self._waiting) if self._waiting else self._take_history()
        if taken is not None and taken.message.qos:
            self._in_flight[taken.ticket] = taken
        return taken

    def grant_history(self, items: int = MAX_HISTORY_ITEMS) -> None:
        """Allow this many more values to be published late; an earlier credit is void."""
        self._history_credit = items

    def acked(self, ticket: int, reason_code: int) -> None:
        """Note the broker's answer; a refusal is set aside and counted, never tried again."""
        sent = self._in_flight.pop(ticket, None)
        if sent is None:
            return
        message = sent.message
        if sent.entries:
            self.backlog.done(sent.entries)
            if message.key:
                self.on_delivered(message.key)
        else:
            if self._held:
                self._sent_live(message)
            if not message.payload and self._latest[message.topic] is message:
                del self._latest[message.topic]
        if reason_code >= FIRST_FAILURE:
            self._refuse(sent, reason_code)

    @property
    def is_idle(self) -> bool:
        """Return whether everything has been sent and acknowledged."""
        return not (self._opening or self._waiting or self._in_flight) and self.backlog.is_empty

    def statistics(self, now_s: float) -> dict[str, Any]:
        """Return the contents of `gateway/outbox`, including what is on the disk."""
        backlog_rows, backlog_bytes, backlog_since_s = self.backlog.waiting()
        flying_s = [sent.since_s for sent in self._in_flight.values() if not sent.entries]
        news_s = [at_s for at_s in (*flying_s, *self._waiting.values()) if at_s is not None]
        since_s = [*news_s, *([] if backlog_since_s is None else [backlog_since_s])]
        latest_bytes = sum(_size(self._latest[topic]) for topic in self._waiting if topic not in self._held)
        return {
            "depth": len(news_s) + backlog_rows - len(self._held),
            "oldest_s": round(max(0.0, now_s - min(since_s)), 3) if since_s else 0.0,
            "bytes": backlog_bytes + latest_bytes,
            "dropped": self.dropped,
            "refused": self.refused,
            "reconnects": max(0, self._connections - 1),
        }

    def _enqueue(self, message: Message, now_s: float) -> None:
        if message.key and self.backlog.knows(message.key):
            return  # an earlier run has left it behind, word for word
        self.backlog.put(Kind.EVENT if message.is_droppable else Kind.RESULT, message, now_s)

    def _hold(self, message: Message, since_s: float) -> None:
        """Queue a newest value as well that cannot be sent now, so that a crash does not lose it."""
        if message.value is not None and message.topic not in self._held:
            item = _late(message.topic, message.value)
            entry = self.backlog.put(Kind.VALUE, item, since_s, is_held=True)
            self._held[message.topic] = (message, entry)

    def _sent_live(self, message: Message) -> None:
        held = self._held.get(message.topic)
        if held is not None and held[0] is message:
            del self._held[message.topic]
            self.backlog.cancel(held[1])

    def _remember(self, message: Message, since_s: float) -> None:
        """Move a replaced value to the history."""
        held = self._held.get(message.topic)
        if held is not None and held[0] is message:
            del self._held[message.topic]
            self.backlog.release(held[1])
        elif message.value is not None:
            self.backlog.put(Kind.VALUE, _late(message.topic, message.value), since_s)

    def _take_latest(self, topics: deque[str] | dict[str, float]) -> Outgoing:
        """Return the newest message of the first of these topics; it has no news any more."""
        topic = next(iter(topics))
        message = self._latest[topic]
        since_s = self._waiting.pop(topic, None)
        if isinstance(topics, deque):
            topics.popleft()
        return self._outgoing(message, since_s)

    def _take_backlog(self) -> Outgoing | None:
        """Return the next result or event; every second old one gives way to a live value."""
        entry = self.backlog.next(self._late_upto) if self.backlog.has_news else None
        if entry is None:
            return None
        is_late = entry.kind is Kind.EVENT and entry.number <= self._late_upto
        if is_late and self._was_late and self._waiting:
            self._was_late = False
            return None
        self._was_late = is_late
        self.backlog.take(entry)
        return self._outgoing(entry.message, entry.since_s, entry)

    def _take_history(self) -> Outgoing | None:
        if self._history_credit <= 0:
            return None
        entries = self.backlog.take_history(min(self._history_credit, MAX_HISTORY_ITEMS))
        if not entries:
            return None
        self._history_credit -= len(entries)
        topic, boot = entries[0].message.topic, entries[0].boot
        batch = HistoryRecord(starter="", boot=boot, items=[entry.message.payload for entry in entries])
        message = Message(topic, batch.payload(), qos=1, retain=False, is_queued=True, is_droppable=True)
        return self._outgoing(message, entries[0].since_s, *entries)

    def _outgoing(self, message: Message, since_s: float | None, *entries: QueuedMessage) -> Outgoing:
        self._tickets += 1
        return Outgoing(self._tickets, message, since_s, entries)

    def _refuse(self, sent: Outgoing, reason_code: int) -> None:
        message = sent.message
        self.refused += 1
        self.refusals.append(RefusedPublish(message.topic, reason_code))
        for entry in sent.entries[:1]:
            self.backlog.refuse(Refusal(entry.since_s, reason_code, message.topic, message.payload))
        self.backlog.on_work()


def _late(topic: str, record: ValueRecord) -> Message:
    """Return a value as an item for its starter's history topic."""
    branch = topic.removesuffix(record.topic)
    history = branch + HistoryRecord.topic_of(starter=record.starter)
    return Message(history, history_item(record), qos=1, retain=False, is_queued=True, is_droppable=True)


def _size(message: Message) -> int:
    return message.packet_size + ROW_BYTES
