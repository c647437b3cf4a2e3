"""The rows that wait for the broker: where each is, and what is to be written or deleted in the table.

| a row is         | since                                                | until                            |
|------------------|------------------------------------------------------|----------------------------------|
| held             | `hold`: a value that is being published live;        | `release`: it waits,             |
|                  | `stage`: a result that is not published yet          | `cancel`: it is gone             |
| waiting          | it came, was released, given back or read            | `take`, `take_history`: it is    |
|                  |                                                      | sent; or it is left, or lost     |
| sent             | it was taken                                         | `done`: it is gone,              |
|                  |                                                      | `give_back`: it waits            |
| left to the table | it waited beyond its queue's window, and is written | `page`: it waits                 |

Nothing here does I/O: `batch` says what is to be written, and `written` or `unwritten` must follow. A row
that is gone before it was written never is; any other is deleted, together with what is written later.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import islice
from typing import NamedTuple

from gateway.mqtt.message import MAX_HISTORY_ITEMS
from gateway.mqtt.outbox.losses import Losses
from gateway.mqtt.outbox.queue import HIGHEST, LOWEST, RankQueue
from gateway.store import Loss, OutboxPage, OutboxRow, Rank, Total

# Why something was lost:
MEMORY_FULL, DISK_FULL, STORE_LOST = "memory_full", "disk_full", "store_lost"
WINDOWS = {Rank.VALUE: 2000, Rank.EVENT: 1000, Rank.RESULT: 1000}  # in memory of a long queue
LOOKAHEAD = 1000  # rows among which a history is gathered
MOST_ROWS = 500  # at a time: this bounds the wait of a start's intent, and the room of the log
MOST_VALUES = 100  # of these
MOST_NEEDED = 2000  # rows that stay for the history, which may be away for good
MOST_DELETED = 200  # at a time: on a full disk they pass through the little room that is left


class Bounds(NamedTuple):
    """How much there may be."""

    rows: int
    bytes: int


class Batch(NamedTuple):
    """A piece of work for the table; without rows a full disk takes it too."""

    rows: Sequence[OutboxRow] = ()
    gone: Mapping[int, Rank] = {}  # rows to delete, by id
    losses: Sequence[Loss] | None = None  # None: the table has them
    has_events: bool = False  # the table has all of them then

    @property
    def is_flushed(self) -> bool:
        """Return whether it must be on the disk itself, not only in the kernel's hands."""
        return any(row.rank is not Rank.VALUE for row in self.rows)


class Backlog:
    """Three queues, one a rank.

    While `is_table_away` rows in memory do not wait for those that only the table has.
    """

    def __init__(self, *, memory: Bounds, table: Bounds) -> None:
        self._bounds = {MEMORY_FULL: memory, DISK_FULL: table}
        self.queues = [RankQueue(WINDOWS[rank]) for rank in Rank]
        self._rows: dict[int, OutboxRow] = {}  # in memory
        self._bytes = 0  # in memory, but for what is held
        self._held: set[int] = set()
        self._staged: dict[tuple[str, bytes], int] = {}  # held rows that somebody else stores: key, payload
        self._unwritten: dict[int, bool] = {}  # with whether the table has it all the same, perhaps
        self._gone: dict[int, Rank] = {}
        self._is_full = False  # perhaps: the latest batch could not be written
        self._needed: dict[str, int | None] = {}  # by key, what must stay; once delivered, its id
        self.history_credit = 0  # values that may be published late
        self.losses = Losses()
        self.is_table_away: Callable[[], bool] = lambda: True

    @property
    def is_empty(self) -> bool:
        """Return whether nothing waits, here or in the table."""
        return not any(queue.rows for queue in self.queues)

    def waiting(self) -> tuple[int, int, float | None]:
        """Return how many rows wait (those sent and in the table too), how many bytes, and since when."""
        queues = self.queues
        here = (id_ for queue in queues for id_ in (*queue.ids[:1], *queue.sent))
        since_s = [self._rows[id_].time_s for id_ in here]
        since_s += [queue.first_s for queue in queues if queue.beyond]
        rows, size = sum(queue.rows for queue in queues), sum(queue.bytes for queue in queues)
        return rows, size, min(since_s, default=None)

    # A row comes, is released, sent, and gone.

    def put(self, row: OutboxRow) -> None:
        """Take a row, or release the one that was staged; of too many the oldest values go first."""
        staged = self._staged.pop((row.key, row.payload), None)
        if staged is not None:
            self.release(staged)
        else:
            self._rows[row.id] = row
            self._unwritten[row.id] = False
            self._enqueue(row)

    def hold(self, row: OutboxRow) -> None:
        """Have a row stored that waits to be released."""
        self._rows[row.id] = row
        self._held.add(row.id)
        self._unwritten[row.id] = False

    def stage(self, row: OutboxRow) -> None:
        """Hold a row that somebody else stores, until the same is put."""
        self._rows[row.id] = row
        self._held.add(row.id)
        self._staged[row.key, row.payload] = row.id

    def is_to_be_stored(self, row: OutboxRow) -> bool:
        """Return whether a staged row must be in the table: the broker does not have it; from any thread."""
        return row.id in self._rows

    def holds(self, id_: int) -> bool:
        """Return whether a row is held."""
        return id_ in self._held

    def release(self, id_: int) -> None:
        """Let a held row be sent."""
        self._held.remove(id_)
        row = self._rows[id_]
        if row.key:  # whether it could be stored is not known here: it is stored again, which changes nothing
            self._unwritten[id_] = True
        self._enqueue(row)

    def cancel(self, id_: int) -> None:
        """Remove a row if it is held: the broker has its message."""
        if id_ in self._held:
            self._held.remove(id_)
            self._forget(self._rows[id_])

    def first(self, rank: Rank) -> OutboxRow | None:
        """Return the row of a rank that comes next; None when there is none, or it is being read."""
        queue = self.queues[rank]
        is_known = queue.is_next_here or self.is_table_away()
        return self._rows[queue.ids[0]] if queue.ids and is_known else None

    def take(self, row: OutboxRow) -> None:
        """Note that what `first` returned is sent."""
        self.queues[row.rank].take(row)

    def take_history(self) -> list[OutboxRow]:
        """Return the next values of one run and starter, which are sent; none beyond the credit."""
        first = self.first(Rank.VALUE) if self.history_credit > 0 else None
        if first is None:
            return []
        queue = self.queues[Rank.VALUE]
        upto = queue.upto if queue.is_next_here else HIGHEST
        near = (self._rows[id_] for id_ in queue.ids[:LOOKAHEAD] if id_ <= upto)
        alike = (row for row in near if (row.topic, row.boot) == (first.topic, first.boot))
        batch = list(islice(alike, min(self.history_credit, MAX_HISTORY_ITEMS)))
        self.history_credit -= len(batch)
        for row in batch:
            queue.take(row)
        return batch

    def done(self, rows: Iterable[OutboxRow]) -> None:
        """Note that the broker has acknowledged what was sent."""
        for row in rows:
            self._dequeue(row)
            if row.key in self._needed:
                self._needed[row.key] = row.id

    def give_back(self) -> None:
        """Let everything wait again that was sent and is not done."""
        for queue in self.queues:
            for row in [self._rows[id_] for id_ in sorted(queue.sent)]:
                queue.give_back(row)
                self._leave_to_table(row)

    def need(self, key: str) -> bool:
        """Have the row of a key stay in the table after its delivery, until `let_go`.

        Return whether there is room for that without letting the oldest one go.
        """
        self._needed.setdefault(key)
        has_room = len(self._needed) <= MOST_NEEDED
        if not has_room:
            del self._needed[next(iter(self._needed))]
        return has_room

    def let_go(self, key: str) -> None:
        """Let a row be deleted once it is delivered; keys that are not needed do not matter."""
        self._needed.pop(key, None)

    # Rows to be written.

    def batch(self) -> Batch | None:
        """Return what is to be written next: deletions with what is new, alone after a failure."""
        needed = frozenset(self._needed.values())
        deletable = (item for item in self._gone.items() if item[0] not in needed)
        gone = dict(islice(deletable, MOST_DELETED))
        self._gone = {id_: rank for id_, rank in self._gone.items() if id_ not in gone}
        if gone and self._is_full:
            return Batch((), gone, self.losses.unstored(has_events=False))
        self._is_full = False
        events = [id_ for id_ in self._unwritten if self._rows[id_].rank is not Rank.VALUE]
        values = (id_ for id_ in self._unwritten if self._rows[id_].rank is Rank.VALUE)
        has_events = len(events) <= MOST_ROWS
        ids = [*events, *islice(values, MOST_VALUES)][:MOST_ROWS]
        losses = self.losses.unstored(has_events=has_events)
        if not (ids or gone) and losses is None:
            return None
        self._unwritten.update(dict.fromkeys(ids, True))
        return Batch([self._rows[id_] for id_ in ids], gone, losses, has_events)

    def written(self, batch: Batch) -> None:
        """Note that a batch is in the table."""
        self.losses.note_stored(batch.losses, has_events=batch.has_events)
        for row in batch.rows:
            if self._unwritten.pop(row.id, False):
                self._leave_to_table(self._rows[row.id])

    def unwritten(self, batch: Batch) -> None:
        """Note that a batch could not be written, as far as is known."""
        self._is_full = True
        self._gone = {**batch.gone, **self._gone}
        if batch.losses is not None:
            self.losses.forget_stored()

    # Answers of the table.

    def expect_table(self) -> None:
        """Take it that there is a table, whose rows of earlier runs come first."""
        for queue in self.queues:
            queue.upto = LOWEST

    def recall(self, totals: Mapping[Rank, Total], losses: Sequence[Loss]) -> None:
        """Begin with what earlier runs have left behind."""
        self.losses.recall(losses)
        for rank, queue in zip(Rank, self.queues, strict=True):
            if rank in totals:
                queue.recall(totals[rank])
            else:
                queue.bring((), HIGHEST, 0.0)

    def wanted(self, *, is_sending: bool) -> list[tuple[Rank, int]]:
        """Return what is to be read, in order to be sent or given up: the ranks, and after which row."""
        wanting = [
            (rank, queue.upto) for rank, queue in zip(Rank, self.queues, strict=True) if queue.wants_page
        ]
        return wanting if is_sending or self._excess() else []

    def page(self, rank: Rank, page: OutboxPage) -> None:
        """Take what was read."""
        queue = self.queues[rank]
        rows = [row for row in page.rows if row.id not in self._rows and row.id not in self._gone]
        self._rows.update((row.id, row) for row in rows)
        self._bytes += sum(row.size for row in rows)
        upto = HIGHEST if page.is_last else page.upto
        queue.bring((row.id for row in rows), upto, page.rows[-1].time_s if page.rows else 0.0)
        if page.is_last:
            self._lose_beyond(rank)
        self._make_room()

    def lose_table(self) -> None:
        """Declare what was only in the table, which is a new one; all the rest is written again."""
        self._gone.clear()
        for rank, queue in zip(Rank, self.queues, strict=True):
            self._lose_beyond(rank)
            queue.bring((), HIGHEST, 0.0)
        own = self._rows.keys() - self._staged.values()  # what is staged is stored with its command's row
        self._unwritten = dict.fromkeys(sorted(own), True)
        self.losses.forget_stored()

    # Inside.

    def _enqueue(self, row: OutboxRow) -> None:
        self._bytes += row.size
        self.queues[row.rank].add(row)
        self._leave_to_table(row)
        self._make_room()

    def _dequeue(self, row: OutboxRow) -> None:
        self._bytes -= row.size
        self.queues[row.rank].remove(row)
        self._forget(row)

    def _forget(self, row: OutboxRow) -> None:
        """Let go of a row, and have the table delete it if it has it, or may have."""
        del self._rows[row.id]
        if self._unwritten.pop(row.id, True):
            self._gone[row.id] = row.rank
        if not self._rows:  # then all three are empty, but keep the room that they once needed
            for table in (self._rows, self._held, self._unwritten):
                table.clear()

    def _make_room(self) -> None:
        """Give up the oldest of the lowest rank, as long as there is too much and it is at hand."""
        while (reason := self._excess()) and (victim := self._victim(reason)) is not None:
            self._dequeue(victim)
            self.losses.add(Loss(reason, victim.rank, 1, victim.time_s, victim.time_s))

    def _excess(self) -> str:
        """Return of what there is too much: of rows in memory, or of all that wait."""
        queues = self.queues
        for reason, rows, size in (
            (MEMORY_FULL, len(self._rows) - len(self._held), self._bytes),
            (DISK_FULL, sum(queue.rows for queue in queues), sum(queue.bytes for queue in queues)),
        ):
            if rows > self._bounds[reason].rows or size > self._bounds[reason].bytes:
                return reason
        return ""

    def _victim(self, reason: str) -> OutboxRow | None:
        """Return the oldest row of the lowest rank that has any; None while that is being read."""
        for rank, queue in zip(Rank, self.queues, strict=True):
            if reason == DISK_FULL and queue.rows > len(queue.sent):
                return self.first(rank)
            if queue.ids:
                return self._rows[queue.ids[0]]
        return None

    def _leave_to_table(self, row: OutboxRow) -> None:
        """Forget a row that the table has, unless it is held, sent or within the window."""
        queue = self.queues[row.rank]
        is_needed = row.id in self._unwritten or row.id in self._held or row.id in queue.sent
        if row.id > queue.upto and not is_needed:
            queue.leave(row)
            del self._rows[row.id]
            self._bytes -= row.size

    def _lose_beyond(self, rank: Rank) -> None:
        """Declare what the table should have and has not."""
        queue = self.queues[rank]
        if queue.beyond > 0:  # less after a page of the table before, of which all was declared lost
            self.losses.add(Loss(STORE_LOST, rank, queue.beyond, queue.first_s, queue.last_s))
        here = sum(self._rows[id_].size for id_ in (*queue.ids, *queue.sent))
        queue.lose_beyond(queue.beyond, queue.bytes - here)
