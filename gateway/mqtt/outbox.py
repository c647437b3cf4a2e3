"""What is still to be told to the broker: the newest of every retained topic, and the rest in order.

Retained topics hold only their newest message, and all of them are sent afresh on every connection. Kept
messages (events, results, audit) are sent in order and stay until the broker has acknowledged them, over any
number of connections. Values that a newer one overtook before they were sent are told later, in batches.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from gateway.mqtt.payload import MAX_HISTORY_ITEMS, HistoryItem, Message, cleared

FIRST_FAILURE = 0x80  # reason codes from here on are refusals [MQTT5 2.4]
ROW_BYTES = 200  # what a row costs besides its topic and payload, roughly
MAX_REMEMBERED_REFUSALS = 100


@dataclass(frozen=True, slots=True)
class Outgoing:
    """A message on its way; `ticket` names it until it is acknowledged."""

    ticket: int
    message: Message
    since_s: float | None  # None: a repetition for a new connection, no news


class Refused(NamedTuple):
    """A publication that the broker would not take; it is not sent again."""

    topic: str
    reason_code: int


class Outbox:
    """The messages of one gateway; lives in memory, does no I/O.

    `last_topic` is sent after all other retained topics of a connection: the gateway's status. `pack` makes
    a message of a history topic and the JSON items for it.
    """

    def __init__(
        self,
        *,
        last_topic: str,
        pack: Callable[[str, Sequence[str]], Message],
        max_rows: int = 20_000,
        max_bytes: int = 16 * 2**20,
    ) -> None:
        self._last_topic = last_topic
        self._pack = pack
        self._max_rows = max_rows
        self._max_bytes = max_bytes
        self._latest: dict[str, Message] = {}
        self._waiting: dict[str, float] = {}  # retained topics with news, and since when
        self._opening: deque[str] = deque()  # what a new connection still has to hear first
        self._kept: deque[Outgoing] = deque()
        self._backlog: deque[tuple[HistoryItem, float]] = deque()
        self._bytes = 0  # of kept, whether sent or not, and of the backlog
        self._in_flight: dict[int, Outgoing] = {}
        self._window = 0  # 0: not connected
        self._tickets = 0
        self._connections = 0
        self.dropped = 0
        self.refused = 0
        self.refusals: deque[Refused] = deque(maxlen=MAX_REMEMBERED_REFUSALS)

    def put(self, message: Message, now_s: float) -> None:
        """Take a message; a full outbox drops history first, then events and audit, then results."""
        if message.is_kept:
            self._keep(message, now_s)
            return
        before = self._latest.get(message.topic)
        if before is not None and message.topic in self._waiting:
            self._remember(before, self._waiting[message.topic])
        self._latest[message.topic] = message
        if message.qos or self._window:  # what QoS 0 says is not missed; the next connection hears the newest
            self._waiting.setdefault(message.topic, now_s)

    def forget(self, branch: str, now_s: float) -> None:
        """Make the broker forget every retained topic below `branch`."""
        for topic in [topic for topic in self._latest if topic.startswith(f"{branch}/")]:
            self.put(cleared(topic), now_s)

    def connected(self, window: int) -> None:
        """Begin a connection on which `window` messages may be unacknowledged."""
        self._window = window
        self._connections += 1
        self._opening = deque(topic for topic in self._latest if topic != self._last_topic)
        if self._last_topic in self._latest:
            self._opening.append(self._last_topic)

    def disconnected(self) -> None:
        """End a connection; what was not acknowledged waits again, in its old order."""
        self._window = 0
        self._opening.clear()
        unacknowledged = list(self._in_flight.values())
        self._in_flight.clear()
        self._kept.extendleft(reversed([sent for sent in unacknowledged if sent.message.is_kept]))
        for sent in unacknowledged:
            if sent.message.is_kept or sent.since_s is None:
                continue
            if self._latest[sent.message.topic] is sent.message:
                self._waiting.setdefault(sent.message.topic, sent.since_s)
            else:
                self._remember(sent.message, sent.since_s)

    def take(self) -> Outgoing | None:
        """Return the next message to publish now, or None when there is none or the window is full."""
        if len(self._in_flight) >= self._window:
            return None
        taken = self._take_latest(self._opening) or self._take_kept() or self._take_latest(self._waiting)
        if taken is None and self._backlog:
            self._pack_backlog()
            taken = self._take_kept()
        if taken is not None and taken.message.qos:
            self._in_flight[taken.ticket] = taken
        return taken

    def acked(self, ticket: int, reason_code: int) -> None:
        """Note the broker's answer; a refusal is set aside and counted, never tried again."""
        sent = self._in_flight.pop(ticket, None)
        if sent is None:
            return
        if sent.message.is_kept:
            self._bytes -= _size(sent.message)
        elif not sent.message.payload and self._latest[sent.message.topic] is sent.message:
            del self._latest[sent.message.topic]
        if reason_code >= FIRST_FAILURE:
            self.refused += 1
            self.refusals.append(Refused(sent.message.topic, reason_code))

    @property
    def is_idle(self) -> bool:
        """Return whether everything has been sent and acknowledged."""
        return not (self._opening or self._waiting or self._kept or self._backlog or self._in_flight)

    def figures(self, now_s: float) -> dict[str, Any]:
        """Return what `gateway/outbox` tells."""
        sent_since_s = [sent.since_s for sent in (*self._kept, *self._in_flight.values())]
        backlog_since_s = [since_s for _, since_s in self._backlog]
        news_s = [*sent_since_s, *self._waiting.values(), *backlog_since_s]
        since_s = [at_s for at_s in news_s if at_s is not None]
        latest_bytes = sum(_size(self._latest[topic]) for topic in self._waiting)
        return {
            "depth": len(since_s),
            "oldest_s": round(max(0.0, now_s - min(since_s)), 3) if since_s else 0.0,
            "bytes": self._bytes + latest_bytes,
            "dropped": self.dropped,
            "refused": self.refused,
            "reconnects": max(0, self._connections - 1),
        }

    def _keep(self, message: Message, now_s: float) -> None:
        self._kept.append(self._outgoing(message, now_s))
        self._bytes += _size(message)
        self._make_room()

    def _remember(self, message: Message, since_s: float) -> None:
        """Put an overtaken value aside, to be told in the history."""
        if message.history is not None:
            self._backlog.append((message.history, since_s))
            self._bytes += _item_size(message.history)
            self._make_room()

    def _make_room(self) -> None:
        while self._is_too_full and (self._kept or self._backlog):
            if self._backlog:
                item, _ = self._backlog.popleft()
                self._bytes -= _item_size(item)
            else:
                droppable = (n for n, sent in enumerate(self._kept) if sent.message.is_droppable)
                victim = next(droppable, 0)
                self._bytes -= _size(self._kept[victim].message)
                del self._kept[victim]
            self.dropped += 1

    @property
    def _is_too_full(self) -> bool:
        return len(self._kept) + len(self._backlog) > self._max_rows or self._bytes > self._max_bytes

    def _take_latest(self, topics: deque[str] | dict[str, float]) -> Outgoing | None:
        """Return the newest message of the first of these topics; it has no news any more."""
        if not topics:
            return None
        topic = next(iter(topics))
        message = self._latest[topic]
        since_s = self._waiting.pop(topic, None)
        if isinstance(topics, deque):
            topics.popleft()
        return self._outgoing(message, since_s)

    def _take_kept(self) -> Outgoing | None:
        return self._kept.popleft() if self._kept else None

    def _pack_backlog(self) -> None:
        """Turn the oldest starter's share of the backlog, up to one batch, into a kept message."""
        topic = self._backlog[0][0].topic
        since_s = self._backlog[0][1]
        batch: list[str] = []
        rest: deque[tuple[HistoryItem, float]] = deque()
        for item, item_since_s in self._backlog:
            if item.topic == topic and len(batch) < MAX_HISTORY_ITEMS:
                batch.append(item.text)
                self._bytes -= _item_size(item)
            else:
                rest.append((item, item_since_s))
        self._backlog = rest
        self._keep(self._pack(topic, batch), since_s)

    def _outgoing(self, message: Message, since_s: float | None) -> Outgoing:
        self._tickets += 1
        return Outgoing(self._tickets, message, since_s)


def _size(message: Message) -> int:
    return message.packet_size + ROW_BYTES


def _item_size(item: HistoryItem) -> int:
    return len(item.text) + ROW_BYTES  # the topic is shared
