"""What is still to be published: the newest message of every retained topic, and rows in their order.

Retained topics hold only their newest message, and all of them are sent again on every connection. All other
messages (events, results, audit) are rows from the moment they are put until the broker has acknowledged
them, over any number of connections and runs. A value becomes a row as well when the broker has not
acknowledged it for a second, or is away: a newer value then leaves it to the history, which is published
late, in batches. A row has the place of its message, also if it was written later.

What goes out next (`Outbox.take`), within the broker's window of unacknowledged messages:

1. on a new connection, every retained topic, the gateway's status last;
2. results and events; of the events from before this connection, at most every second one;
3. retained topics with a new message;
4. the history, within the credit that `grant_history` gives.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from gateway.contract import HistoryRecord, Record, ValueRecord, history_item
from gateway.mqtt.message import FIRST_FAILURE, Message, message_at
from gateway.mqtt.outbox.backlog import Backlog, Bounds
from gateway.store import OutboxRow, Rank

HISTORY_ITEMS = 1000  # that are published late, for each pulse of the connection
HELD_AFTER_S = 1.0  # a value that waits for longer is written
IN_MEMORY = Bounds(20_000, 16 * 2**20)
IN_TABLE = Bounds(400_000, 48 * 2**20)  # of a file of 256 MiB, which has the audit too


class Outgoing(NamedTuple):
    """A message on its way; `ticket` names it until it is acknowledged, and a value's late row."""

    ticket: int
    message: Message
    since_s: float | None = None  # of a retained message that is new
    rows: Sequence[OutboxRow] = ()


class Outbox:
    """The messages of one gateway; does no I/O.

    `last_topic` is sent after all other retained topics of a connection: the gateway's status. `boot` names
    this run, to which the rows belong.
    """

    def __init__(
        self,
        *,
        last_topic: str,
        boot: str = "",
        memory: Bounds = IN_MEMORY,
        table: Bounds = IN_TABLE,
        utc_of: Callable[[float], float] = float,
    ) -> None:
        self._last_topic = last_topic
        self._boot = boot
        self._utc_of = utc_of
        self.backlog = Backlog(memory=memory, table=table)
        self._latest: dict[str, Record | Message] = {}  # what the newest message of a topic is made of
        self._news: dict[str, Outgoing] = {}  # by topic; not sent yet
        self._opening: deque[str] = deque()  # topics that a new connection still has to send first
        self._in_flight: dict[int, Outgoing] = {}
        self._window = 0  # 0: not connected
        self._numbers = 0  # the last ticket
        self._connections = 0
        self._late_upto = 0  # the id of the last row from before this connection
        self._was_late = False
        self.refused = 0  # messages that the broker would not take; they are not sent again
        self.on_refused: Callable[[str, int], None] = lambda *_: None  # called with topic and reason code

    @property
    def is_connected(self) -> bool:
        """Return whether messages go out now."""
        return self._window > 0

    @property
    def is_idle(self) -> bool:
        """Return whether everything has been sent and acknowledged."""
        return not (self._opening or self._news or self._in_flight) and self.backlog.is_empty

    def retained(self, topic: str) -> Message | None:
        """Return the newest message of a retained topic; None once the broker has been made to forget it."""
        source = self._latest.get(topic)
        return None if source is None else message_at(topic, source)

    def has(self, topic: str) -> bool:
        """Return whether a retained topic has a message."""
        return topic in self._latest

    def stage(self, message: Message, now_s: float) -> OutboxRow:
        """Return the row of a message with a key, which the caller stores; `put` then has it sent.

        A row that the caller could not store is stored after its `put`, like any other.
        """
        row = self._row(message, now_s)
        self.backlog.stage(row)
        return row

    def put(self, message: Message, now_s: float) -> None:
        """Take a message; a full outbox drops history first, then events and audit, then results."""
        if not message.retain:
            self.backlog.put(self._row(message, now_s))
            return
        topic = message.topic
        self._numbers += 1
        news = Outgoing(self._numbers, message, now_s)
        replaced = self._news.get(topic)
        self._latest[topic] = message.source
        if message.qos or self._window:
            self._news[topic] = news
        else:  # QoS 0 while offline: the next connection sends the newest
            self._news.pop(topic, None)
        if replaced is not None:  # unsent
            self._leave_to_history(replaced)
        if not self._window:
            self._hold(news)

    def records(self) -> list[Record]:
        """Return the newest record of each retained topic that has one."""
        return [source for source in self._latest.values() if isinstance(source, Record)]

    def topics(self) -> list[str]:
        """Return the retained topics that have a message."""
        return [*self._latest]

    def connected(self, window: int) -> None:
        """Begin a connection on which `window` messages may be unacknowledged."""
        self._window = window
        self._connections += 1
        self._opening = deque(topic for topic in self._latest if topic != self._last_topic)
        if self._last_topic in self._latest:
            self._opening.append(self._last_topic)
        self._late_upto = self._numbers

    def disconnected(self) -> None:
        """End a connection; what was not acknowledged waits again, in its old order."""
        self._window = 0
        self._opening.clear()
        unacknowledged = self._unacknowledged()
        self._in_flight.clear()
        self.backlog.give_back()
        for news in unacknowledged:
            if self._latest.get(news.message.topic) is news.message.source:
                self._news.setdefault(news.message.topic, news)
            else:
                self._leave_to_history(news)
        for news in self._news.values():
            self._hold(news)

    def hold_slow(self, now_s: float) -> None:
        """Have values written that the broker has not acknowledged for too long.

        While it is away every value was held when it was put: there is nothing to look for.
        """
        if self.is_connected:
            for news in (*self._unacknowledged(), *self._news.values()):
                if news.since_s is not None and now_s - news.since_s >= HELD_AFTER_S:
                    self._hold(news)

    def take(self) -> Outgoing | None:
        """Return the next message to publish now, or None when there is none or the window is full."""
        if len(self._in_flight) >= self._window:
            return None
        if self._opening:
            taken: Outgoing | None = self._take_latest(self._opening.popleft())
        elif (row := self._next_row()) is not None:
            self.backlog.take(row)
            message = Message(row.topic, row.payload, qos=1, retain=False, correlation=row.correlation)
            taken = Outgoing(self._next_number(), message, rows=(row,))
        elif self._news:
            taken = self._take_latest(next(iter(self._news)))
        else:
            taken = self._take_history()
        if taken is not None and taken.message.qos:
            self._in_flight[taken.ticket] = taken
        return taken

    def grant_history(self, items: int = HISTORY_ITEMS) -> None:
        """Allow this many more values to be published late; an earlier credit is void."""
        self.backlog.history_credit = items

    def acked(self, ticket: int, reason_code: int) -> None:
        """Note the broker's answer; a refusal is counted, and what was refused is never tried again."""
        sent = self._in_flight.pop(ticket, None)
        if sent is None:
            return
        message = sent.message
        if sent.rows:
            self.backlog.done(sent.rows)
        else:
            self.backlog.cancel(ticket)
            if not message.payload and self._latest.get(message.topic) is message:
                del self._latest[message.topic]
        if reason_code >= FIRST_FAILURE:
            self.refused += 1
            self.on_refused(message.topic, reason_code)

    def statistics(self, now_s: float) -> dict[str, Any]:
        """Return the contents of `gateway/outbox`, including what is on the disk."""
        rows, size, since_utc_s = self.backlog.waiting()
        news = [*self._unacknowledged(), *self._news.values()]
        ages_s = [now_s - each.since_s for each in news if each.since_s is not None]
        ages_s += [] if since_utc_s is None else [self._utc_of(now_s) - since_utc_s]
        return {
            "depth": len(news) + rows,
            "oldest_s": round(max(0.0, *ages_s, 0.0), 3),
            "bytes": size + sum(each.message.packet_size for each in news),
            "dropped": self.backlog.losses.dropped,
            "refused": self.refused,
            "reconnects": max(0, self._connections - 1),
        }

    def _next_number(self) -> int:
        self._numbers += 1
        return self._numbers

    def _unacknowledged(self) -> list[Outgoing]:
        """Return the retained messages that were sent and are new to the broker."""
        return [sent for sent in self._in_flight.values() if sent.since_s is not None]

    def _row(self, message: Message, now_s: float) -> OutboxRow:
        return OutboxRow(
            self._next_number(),
            Rank.EVENT if message.record and message.record.IS_DROPPABLE else Rank.RESULT,
            message.topic,
            message.payload,
            self._utc_of(now_s),
            self._boot,
            message.key,
            message.correlation,
        )

    def _hold(self, news: Outgoing) -> None:
        """Have a value stored that is still to be published live, so that a crash does not lose it."""
        if not self.backlog.holds(news.ticket) and (late := self._late(news)) is not None:
            self.backlog.hold(late)

    def _leave_to_history(self, news: Outgoing) -> None:
        """Let a value that was replaced be published late."""
        if self.backlog.holds(news.ticket):
            self.backlog.release(news.ticket)
        elif (late := self._late(news)) is not None:
            self.backlog.put(late)

    def _late(self, news: Outgoing) -> OutboxRow | None:
        """Return a value as an item for its starter's history topic; None for any other message."""
        record = news.message.record
        if not isinstance(record, ValueRecord) or news.since_s is None:
            return None
        topic = news.message.topic.removesuffix(record.topic) + HistoryRecord.topic_of(starter=record.starter)
        utc_s = self._utc_of(news.since_s)
        return OutboxRow(news.ticket, Rank.VALUE, topic, history_item(record), utc_s, self._boot, "")

    def _take_latest(self, topic: str) -> Outgoing:
        """Return the newest message of a topic: its news, or a repetition for a new connection."""
        news = self._news.pop(topic, None)
        return news or Outgoing(self._next_number(), message_at(topic, self._latest[topic]))

    def _next_row(self) -> OutboxRow | None:
        """Return the older of the next result and the next event; no new result waits for old events.

        Every second old event gives way to a live value.
        """
        queues = self.backlog.queues  # looked at first for speed: there is seldom anything in these two
        if not (queues[Rank.RESULT].rows or queues[Rank.EVENT].rows):
            return None
        result, event = self.backlog.first(Rank.RESULT), self.backlog.first(Rank.EVENT)
        is_late = event is not None and event.id <= self._late_upto
        if result and event and (result.id < event.id or (is_late and result.id > self._late_upto)):
            event = None
        if event is None or not is_late:
            self._was_late = False
            return event or result
        self._was_late = not (self._was_late and self._news)
        return event if self._was_late else None

    def _take_history(self) -> Outgoing | None:
        rows = self.backlog.take_history()
        if not rows:
            return None
        batch = HistoryRecord(starter="", boot=rows[0].boot, items=[row.payload for row in rows])
        message = Message(rows[0].topic, batch.payload(), qos=1, retain=False)
        return Outgoing(self._next_number(), message, rows=rows)
