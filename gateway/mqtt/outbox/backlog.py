"""What waits for the broker while it is away: results, events, and values that a newer one replaced.

Each entry stays until the broker has acknowledged it. A disk, where there is one, stores it a moment later,
and holds what exceeds the memory. This class does no I/O: `collect` returns what the disk has to write next.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from itertools import chain, islice

from gateway.mqtt.message import Message
from gateway.mqtt.outbox.segment import (
    LOWEST,
    MessageState,
    QueuedMessage,
    Segment,
    Wanted,
    entry_of,
    in_order,
    row_of,
)
from gateway.storage.spool import Changes, Kind, Loss, Recalled, Refusal, SpoolPage, merged

HIGHEST = 2**62
MOST_AT_ONCE = 500  # rows in one transaction
MOST_REFUSALS = 100  # that wait for the disk
MEMORY, STORE = "memory_full", "store_lost"  # why something was lost
WINDOWS = {Kind.VALUE: 2000, Kind.EVENT: 1000, Kind.RESULT: 1000}  # in memory, when there is more on a disk


class Backlog:
    """Six segments: three kinds, each of this run and of earlier runs; bounded in memory by rows and bytes.

    `on_work` is called when there is something for the disk to do. Times are the steady clock's.
    """

    def __init__(self, *, boot: str, max_rows: int, max_bytes: int) -> None:
        self._boot = boot
        self._max_rows = max_rows
        self._max_bytes = max_bytes
        self._old = {kind: Segment(kind, window=WINDOWS[kind], end=1) for kind in Kind}
        self._new = {kind: Segment(kind, window=WINDOWS[kind], end=HIGHEST) for kind in Kind}
        self._segments = (*self._old.values(), *self._new.values())
        self._out: dict[int, QueuedMessage] = {}  # taken and not acknowledged
        self._out_bytes = 0
        self._numbers = 0
        self.has_news = False  # whether `next` may have something; looked at for each value that is sent
        self._fresh: dict[int, QueuedMessage] = {}
        self._writing: list[QueuedMessage] = []
        self._gone: list[tuple[Kind, int]] = []
        self._refusals: deque[Refusal] = deque(maxlen=MOST_REFUSALS)
        self._losses: tuple[Loss, ...] = ()  # of memory; times of the steady clock
        self._keys: frozenset[str] = frozenset()
        self.dropped = 0
        self.is_disk_away: Callable[[], bool] = lambda: True
        self.on_work: Callable[[], None] = lambda: None

    @property
    def last_number(self) -> int:
        """Return the number of the newest entry."""
        return self._numbers

    @property
    def is_empty(self) -> bool:
        """Return whether nothing waits, here or on the disk."""
        return not self._out and not any(len(segment) or segment.sunk.rows for segment in self._segments)

    @property
    def has_history(self) -> bool:
        """Return whether values wait to be published late."""
        segments = (self._old[Kind.VALUE], self._new[Kind.VALUE])
        return any(not entry.is_held for segment in segments for entry in segment) or any(
            segment.sunk.rows for segment in segments
        )

    def knows(self, key: str) -> bool:
        """Return whether an earlier run has left the message of this key behind."""
        return key in self._keys

    def put(self, kind: Kind, message: Message, since_s: float, *, is_held: bool = False) -> QueuedMessage:
        """Add a message or a value; when memory is full the oldest values go first, results last."""
        self._numbers += 1
        entry = QueuedMessage(
            self._numbers, kind, message, self._boot, since_s, self._new[kind], is_held=is_held
        )
        entry.segment.add(entry)
        self._fresh[entry.number] = entry
        self.has_news |= kind is not Kind.VALUE
        self._make_room()
        self.on_work()
        return entry

    def next(self, late_upto: int) -> QueuedMessage | None:
        """Return the result or event that comes next; what is not `late` does not wait for what is."""
        is_away = self.is_disk_away()
        result, event = (self._first(kind, is_away, late_upto) for kind in (Kind.RESULT, Kind.EVENT))
        if result is None or event is None:
            self.has_news = bool(result or event) or any(segment.sunk.rows for segment in self._segments)
            return result or event
        is_result_late = result.number <= late_upto
        is_event_first = event.number < result.number and (is_result_late or event.number > late_upto)
        return event if is_event_first else result

    def take(self, entry: QueuedMessage) -> None:
        """Remove what `next` returned, until it is done or given back."""
        entry.segment.take(entry)
        self._fly(entry)

    def take_history(self, most: int) -> list[QueuedMessage]:
        """Remove some values of one run and starter, until they are done or given back."""
        is_away = self.is_disk_away()
        for segment in (self._old[Kind.VALUE], self._new[Kind.VALUE]):
            batch = segment.take_batch(most, is_disk_away=is_away)
            if batch:
                for entry in batch:
                    self._fly(entry)
                self.on_work()  # another page may be wanted
                return batch
        return []

    def done(self, entries: Sequence[QueuedMessage]) -> None:
        """Note that the broker has acknowledged what was taken."""
        for entry in entries:
            del self._out[entry.number]
            self._out_bytes -= entry.size
            entry.is_gone = True
            self._note_gone(entry)
        self.on_work()

    def cancel(self, entry: QueuedMessage) -> None:
        """Remove an entry that is no longer needed: its value was published live."""
        if not entry.is_gone:
            entry.segment.cancel(entry)
            self._note_gone(entry)
            self.on_work()

    def release(self, entry: QueuedMessage) -> None:
        """Let the history include a value that was held for its live publication."""
        entry.is_held = False
        if entry.is_gone:
            self._lose(MEMORY, entry)

    def give_back_all(self) -> None:
        """Put everything that was taken and not done back, in its old order."""
        for segment in self._segments:
            taken = in_order(entry for entry in self._out.values() if entry.segment is segment)
            segment.give_back(taken)
        self._out.clear()
        self._out_bytes = 0
        self.has_news = True

    def refuse(self, refusal: Refusal) -> None:
        """Set aside what the broker would not take; its time is the steady clock's."""
        self._refusals.append(refusal)

    def waiting(self) -> tuple[int, int, float | None]:
        """Return how many rows wait (here, on their way, and on the disk), how many bytes, and since when."""
        shares = [segment.sunk for segment in self._segments if segment.sunk.rows]
        since_s = [share.first_s for share in shares]
        since_s += [entry.since_s for entry in chain(*self._segments, self._out.values())]
        rows = (
            sum(len(segment) for segment in self._segments)
            + len(self._out)
            + sum(each.rows for each in shares)
        )
        return rows, self._bytes + sum(each.bytes for each in shares), min(since_s, default=None)

    # What the disk has to write.

    def collect(self, utc_of: Callable[[float], float]) -> Changes | None:
        """Return what the disk is to do next, None for nothing; `written` or `unwritten` must follow."""
        self._writing = list(islice(self._fresh.values(), MOST_AT_ONCE))
        for entry in self._writing:
            del self._fresh[entry.number]
            entry.state = MessageState.WRITING
        changes = Changes(
            rows=tuple(row_of(entry, utc_of) for entry in self._writing),
            gone=tuple(self._gone),
            refusals=tuple(each._replace(time_s=utc_of(each.time_s)) for each in self._refusals),
        )
        self._gone.clear()
        self._refusals.clear()
        return changes if changes.rows or changes.gone or changes.refusals else None

    def written(self) -> None:
        """Note that the disk has done what `collect` returned."""
        for entry in self._writing:
            entry.state = MessageState.WRITTEN
            if entry.is_gone:
                self._note_gone(entry)
        self._writing = []
        for segment in self._segments:
            segment.thin()

    def unwritten(self, changes: Changes) -> None:
        """Note that the disk could not do it."""
        again = [entry for entry in self._writing if not entry.is_gone]
        for entry in again:
            entry.state = MessageState.FRESH
        self._fresh = {entry.number: entry for entry in again} | self._fresh
        self._writing = []
        self._gone[:0] = changes.gone
        self._refusals.extendleft(reversed(changes.refusals))

    def take_losses(self, utc_of: Callable[[float], float]) -> tuple[Loss, ...]:
        """Return what memory could not hold since the last time."""
        losses, self._losses = self._losses, ()
        return tuple(
            each._replace(
                first_s=None if each.first_s is None else utc_of(each.first_s),
                last_s=None if each.last_s is None else utc_of(each.last_s),
            )
            for each in losses
        )

    # What the disk reports.

    def recall(self, recalled: Recalled) -> None:
        """Begin with what earlier runs have left behind; its times are the steady clock's."""
        self._keys = recalled.keys
        self.has_news = True
        for kind, share in recalled.shares.items():
            self._old[kind].begin(share)

    def wanted(self) -> Iterator[tuple[Segment, Wanted]]:
        """Yield what is to be read from the disk; call `page`, or the segment's `no_page`, after each."""
        for segment in self._segments:
            if (wanted := segment.wanted()) is not None:
                yield segment, wanted

    def page(self, segment: Segment, page: SpoolPage) -> None:
        """Take what was read; its times are the steady clock's."""
        known = {entry.number for entry in segment} | self._out.keys() | {number for _, number in self._gone}
        entries = [entry_of(row, segment) for row in page.rows if row.number not in known]
        lost = sum(each.rows for each in page.losses)
        upto = max((row.number for row in page.rows), default=LOWEST)
        missing = segment.page(entries, upto=upto, is_last=page.is_last, lost=lost)
        self.dropped += lost
        self.has_news = True
        if missing:
            self._add_loss(Loss(STORE, segment.kind, missing, None, None))

    def drop(self, loss: Loss) -> None:
        """Give up what the disk had no room for."""
        segments = (self._old[loss.kind], self._new[loss.kind])
        out = (
            each
            for each in self._out.values()
            if each.segment in segments and each.state is MessageState.WRITTEN
        )
        rest = loss.rows - sum(each.number <= loss.upto for each in out)
        rest -= sum(segment.forget(loss.upto) for segment in segments)
        for segment in segments:
            rest -= segment.forget_sunk(max(rest, 0))
        self.dropped += loss.rows

    def lose_disk(self) -> None:
        """Declare what was only on the disk; all the rest is written again."""
        for segment in self._segments:
            first_s = segment.sunk.first_s
            if lost := segment.lose_disk():
                self._add_loss(Loss(STORE, segment.kind, lost, first_s, None))
        self._gone.clear()
        entries = in_order(chain(*self._segments, self._out.values()))
        for entry in entries:
            if entry.state is MessageState.WRITTEN:
                entry.state = MessageState.FRESH
        self._fresh = {entry.number: entry for entry in entries if entry.state is MessageState.FRESH}
        self.on_work()

    # Inside.

    @property
    def _bytes(self) -> int:
        return sum(segment.bytes for segment in self._segments) + self._out_bytes

    def _first(self, kind: Kind, is_away: bool, late_upto: int = HIGHEST) -> QueuedMessage | None:  # noqa: FBT001 - asked once for several
        """Return the oldest, or what is not late; what is late waits while earlier runs' is being read."""
        old, new = self._old[kind], self._new[kind].first(is_disk_away=is_away)
        if new is not None and new.number > late_upto:
            return new
        first = old.first(is_disk_away=is_away)
        return first if first is not None or (old.sunk.rows and not is_away) else new

    def _fly(self, entry: QueuedMessage) -> None:
        self._out[entry.number] = entry
        self._out_bytes += entry.size

    def _make_room(self) -> None:
        while (
            self._bytes > self._max_bytes or sum(len(segment) for segment in self._segments) > self._max_rows
        ):
            victims = (self._first(kind, is_away=True) for kind in Kind)
            victim = next((each for each in victims if each is not None), None)
            if victim is None:
                return
            victim.segment.take(victim)
            victim.is_gone = True
            self._note_gone(victim)
            if not victim.is_held:
                self._lose(MEMORY, victim)

    def _note_gone(self, entry: QueuedMessage) -> None:
        """Have the disk forget an entry that it knows."""
        self._fresh.pop(entry.number, None)
        if entry.state in (MessageState.WRITTEN, MessageState.SUNK):
            self._gone.append((entry.kind, entry.number))

    def _lose(self, reason: str, entry: QueuedMessage) -> None:
        self._add_loss(Loss(reason, entry.kind, 1, entry.since_s, entry.since_s))

    def _add_loss(self, loss: Loss) -> None:
        self._losses = merged((*self._losses, loss))
        self.dropped += loss.rows
