"""Messages of one kind in their order: the first and the newest in memory, on a disk what lies between.

    head (memory) | sunk (only on the disk) | tail (memory)

Entries go in at the tail's end, and sink once they are written and the head is long enough; the head is
filled up again page by page. With nothing sunk there is only the head.
"""

from __future__ import annotations

import enum
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from gateway.mqtt.message import Message
from gateway.storage.spool import Kind, Row, Share

ROW_BYTES = 200  # what a row costs besides its topic and payload, roughly
LOOKAHEAD = 1000  # entries among which a batch is gathered
MOST_GONE = 100  # entries that may stay in a segment although they are done
LOWEST = -(2**62)


class MessageState(enum.Enum):
    """How far the disk knows an entry."""

    FRESH = enum.auto()
    WRITING = enum.auto()
    WRITTEN = enum.auto()
    SUNK = enum.auto()  # on the disk only


@dataclass(slots=True, eq=False)
class QueuedMessage:
    """One message, or one item of a history (its topic, the item's JSON)."""

    number: int
    kind: Kind
    message: Message
    boot: str
    since_s: float
    segment: Segment
    state: MessageState = MessageState.FRESH
    is_gone: bool = False  # acknowledged, or given up
    is_held: bool = False  # its value is being published live; the history leaves it out meanwhile
    size: int = field(init=False)

    def __post_init__(self) -> None:
        self.size = self.message.packet_size + ROW_BYTES


class Wanted(NamedTuple):
    """Which rows a segment wants from the disk: those between these numbers, exclusive."""

    after: int
    before: int


class Segment:
    """The order of one kind; `window` is how much of a long one is in memory when the rest is on a disk."""

    def __init__(self, kind: Kind, *, window: int, end: int) -> None:
        self.kind = kind
        self.sunk = Share(0, 0, 0.0)
        self.bytes = 0  # in memory
        self._window = window
        self._end = end  # no entry has this number or a higher one
        self._head: deque[QueuedMessage] = deque()
        self._tail: deque[QueuedMessage] = deque()
        self._gone = 0  # entries that are still in head or tail although they are gone
        self._edge = LOWEST  # the last number before what has sunk
        self._sunk_since_asked: int | None = None  # None: no page is on its way

    def __len__(self) -> int:
        return len(self._head) + len(self._tail) - self._gone

    def __iter__(self) -> Iterator[QueuedMessage]:
        return (entry for part in (self._head, self._tail) for entry in part if not entry.is_gone)

    def add(self, entry: QueuedMessage) -> None:
        """Take the newest entry."""
        (self._tail if self.sunk.rows else self._head).append(entry)
        self.bytes += entry.size

    def first(self, *, is_disk_away: bool) -> QueuedMessage | None:
        """Return what comes next; while the disk is away nothing waits for what has sunk."""
        for part in (self._head, self._tail):
            while part and part[0].is_gone:
                part.popleft()
                self._gone -= 1
            if part:
                return part[0]
            if self.sunk.rows and not is_disk_away:
                return None
        return None

    def take(self, entry: QueuedMessage) -> None:
        """Remove the entry that `first` returned."""
        (self._head if self._head else self._tail).popleft()
        self.bytes -= entry.size

    def take_batch(self, most: int, *, is_disk_away: bool) -> list[QueuedMessage]:
        """Remove and return the next entries of one run and topic, without those that are held."""
        batch: list[QueuedMessage] = []
        passed: list[QueuedMessage] = []
        part = self._tail if is_disk_away and not self._head else self._head
        while part and len(batch) < most and len(batch) + len(passed) < LOOKAHEAD:
            entry = part.popleft()
            if entry.is_gone:
                self._gone -= 1
            elif entry.is_held or (batch and _place(entry) != _place(batch[0])):
                passed.append(entry)
            else:
                batch.append(entry)
                self.bytes -= entry.size
        part.extendleft(reversed(passed))
        return batch

    def give_back(self, entries: Sequence[QueuedMessage]) -> None:
        """Put what was taken back to the front, in its old order."""
        self._head.extendleft(reversed(entries))
        self.bytes += sum(entry.size for entry in entries)

    def cancel(self, entry: QueuedMessage) -> None:
        """Leave out an entry that has not been taken."""
        entry.is_gone = True
        if entry.state is MessageState.SUNK:
            if entry.number > self._edge:  # else it has come back with a page
                self.sunk = _less(self.sunk, 1, entry.size)
        else:
            self._gone += 1
            self.bytes -= entry.size
            if self._gone > max(MOST_GONE, len(self)):
                self._sweep()

    def thin(self) -> None:
        """Let go of what is written, beyond the window."""
        if not self.sunk.rows:
            if len(self._head) <= self._window:
                return
            self._head = deque(in_order(self._head))  # what was given back may stand before what is older
            while len(self._head) > self._window:
                self._tail.appendleft(self._head.pop())
            self._edge = self._head[-1].number
        while self._tail and (self._tail[0].is_gone or self._tail[0].state is MessageState.WRITTEN):
            self._sink(self._tail.popleft())
        self._join()

    def begin(self, share: Share) -> None:
        """Begin with what is on the disk only; its time is the steady clock's."""
        self.sunk = share

    def wanted(self) -> Wanted | None:
        """Return which page is wanted now, if any; `page` or `no_page` must follow."""
        if not self.sunk.rows or self._sunk_since_asked is not None or len(self._head) > self._window // 2:
            return None
        self._sunk_since_asked = 0
        return Wanted(self._edge, self._tail[0].number if self._tail else self._end)

    def no_page(self) -> None:
        """Note that the page that was wanted does not come."""
        self._sunk_since_asked = None

    def page(self, entries: Sequence[QueuedMessage], *, upto: int, is_last: bool, lost: int) -> int:
        """Take a page that ends with number `upto`; return how many rows are missing, besides the `lost`."""
        if self._sunk_since_asked is None:
            return 0  # the disk was lost meanwhile, and this is declared
        since, self._sunk_since_asked = self._sunk_since_asked, None
        left = max(self.sunk.rows - len(entries) - lost, 0)
        missing = max(left - since, 0) if is_last else 0
        rows = min(since, left) if is_last else max(left, 1)
        size = sum(entry.size for entry in entries)
        first_s = entries[-1].since_s if entries else self.sunk.first_s
        self.sunk = Share(rows, max(self.sunk.bytes - size, 0) if rows else 0, first_s)
        self._head.extend(entries)
        self.bytes += size
        self._edge = max(self._edge, upto)
        self._join()
        return missing

    def forget(self, upto: int) -> int:
        """Give up what the disk has dropped: written entries up to this number; return how many were here."""
        dropped = [each for each in self if each.number <= upto and each.state is MessageState.WRITTEN]
        for entry in dropped:
            self.cancel(entry)
        return len(dropped)

    def lose_disk(self) -> int:
        """Note that what has sunk is gone; return how many there were."""
        self._sunk_since_asked = None
        return self.forget_sunk(self.sunk.rows)

    def forget_sunk(self, most: int) -> int:
        """Give up so many of those that have sunk; return how many there were."""
        rows = min(most, self.sunk.rows)
        self.sunk = _less(self.sunk, rows, self.sunk.bytes * rows // max(self.sunk.rows, 1))
        self._join()
        return rows

    def _sweep(self) -> None:
        """Remove entries that are done, also those behind entries that are never taken."""
        self._head = deque(entry for entry in self._head if not entry.is_gone)
        self._tail = deque(entry for entry in self._tail if not entry.is_gone)
        self._gone = 0

    def _sink(self, entry: QueuedMessage) -> None:
        if entry.is_gone:
            self._gone -= 1
            return
        entry.state = MessageState.SUNK
        first_s = self.sunk.first_s if self.sunk.rows else entry.since_s
        self.sunk = Share(self.sunk.rows + 1, self.sunk.bytes + entry.size, first_s)
        self.bytes -= entry.size
        if self._sunk_since_asked is not None:
            self._sunk_since_asked += 1

    def _join(self) -> None:
        if not self.sunk.rows:
            self._head.extend(self._tail)
            self._tail.clear()


def in_order(entries: Iterable[QueuedMessage]) -> list[QueuedMessage]:
    """Return entries by their numbers."""
    return sorted(entries, key=lambda entry: entry.number)


def row_of(entry: QueuedMessage, utc_of: Callable[[float], float]) -> Row:
    """Return an entry as the disk knows it."""
    message = entry.message
    return Row(
        number=entry.number,
        kind=entry.kind,
        boot=entry.boot,
        topic=message.topic,
        payload=message.payload,
        correlation=message.correlation,
        key=message.key,
        time_s=utc_of(entry.since_s),
    )


def entry_of(row: Row, segment: Segment) -> QueuedMessage:
    """Return what the disk knows as an entry; the row's time is the steady clock's."""
    message = Message(
        row.topic,
        row.payload,
        qos=1,
        retain=False,
        is_queued=True,
        is_droppable=row.kind is not Kind.RESULT,
        correlation=row.correlation,
        key=row.key,
    )
    return QueuedMessage(row.number, row.kind, message, row.boot, row.time_s, segment, MessageState.WRITTEN)


def _place(entry: QueuedMessage) -> tuple[str, str]:
    return entry.message.topic, entry.boot


def _less(share: Share, rows: int, size: int) -> Share:
    return Share(max(share.rows - rows, 0), max(share.bytes - size, 0), share.first_s)
