"""The rows that wait for the broker: which of them are in memory, and what is to be written.

A row in memory is in exactly one place: held (it waits for its word: a staged result, or a value that is
being published live), in flight, or in its queue. It leaves memory when it is gone, or when it is written and
beyond the queue's window. Nothing here does I/O: `batches` says what is to be written, and `written` or
`unwritten` must follow. A row that the broker has acknowledged before that is never written; one that was is
deleted together with what is written later.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import islice
from typing import NamedTuple

from gateway.mqtt.outbox.losses import Losses
from gateway.mqtt.outbox.queue import HIGHEST, RankQueue
from gateway.store import Loss, OutboxPage, OutboxRow, Rank, Total

# Why something was lost:
MEMORY_FULL, DISK_FULL, STORE_LOST, DAMAGED = "memory_full", "disk_full", "store_lost", "damaged"
WINDOWS = {Rank.VALUE: 2000, Rank.EVENT: 1000, Rank.RESULT: 1000}  # in memory of a long queue
LOOKAHEAD = 1000  # rows among which a history is gathered
MOST_ROWS = 500  # at a time: the intent of a start waits for no more, and the log takes no more room
MOST_VALUES = 100  # of these
MOST_NEEDED = 2000  # rows that stay for the history, which may be away for good
MOST_DELETED = 200  # at a time: on a full disk they pass through the little room that is left


class Bounds(NamedTuple):
    """How much there may be."""

    rows: int
    bytes: int


class Gone(NamedTuple):
    """A row that the table has to delete: the broker has it, or it is lost."""

    rank: Rank
    is_lost: bool


class Batch(NamedTuple):
    """What is to be written at once; without rows a full disk takes it too."""

    rows: Sequence[OutboxRow] = ()
    gone: Mapping[int, Gone] = {}  # rows that are to be deleted, by id
    losses: Sequence[Loss] | None = None  # None: the table has them
    has_events: bool = False  # the table has all of them then

    @property
    def is_flushed(self) -> bool:
        """Return whether it must be on the disk itself, not only in the kernel's hands."""
        return any(row.rank is not Rank.VALUE for row in self.rows)


class Backlog:
    """Three queues, one a rank. `on_work` is called when the disk has something to do now.

    Times are the steady clock's, and `utc_of` makes wall times of them. While `is_table_away` what is in
    memory does not wait for what is only in the table.
    """

    def __init__(self, *, memory: Bounds, table: Bounds, utc_of: Callable[[float], float]) -> None:
        self._bounds = {MEMORY_FULL: memory, DISK_FULL: table}
        self._utc_of = utc_of
        self.queues = {rank: RankQueue(WINDOWS[rank]) for rank in Rank}
        self._memory: dict[int, OutboxRow] = {}
        self._bytes = 0  # in memory, but for what is held
        self._held: set[int] = set()
        self._staged: dict[tuple[str, bytes], int] = {}  # held rows that somebody else stores: key, payload
        self._flying: set[int] = set()
        self._unwritten: dict[int, bool] = {}  # with whether the table has it all the same, perhaps
        self._gone: dict[int, Gone] = {}
        self._needed: dict[str, int | None] = {}  # by key, what must stay; once delivered, its id
        self.losses = Losses()
        self.is_table_away: Callable[[], bool] = lambda: True
        self.on_work: Callable[[], None] = lambda: None

    @property
    def is_empty(self) -> bool:
        """Return whether nothing waits, here or in the table."""
        return not self._flying and not any(queue.rows for queue in self.queues.values())

    @property
    def has_history(self) -> bool:
        """Return whether values wait to be published late."""
        return self.queues[Rank.VALUE].rows > 0

    def waiting(self) -> tuple[int, int, float | None]:
        """Return how many rows wait (in flight and in the table too), how many bytes, and since when."""
        flying = [self._memory[id_] for id_ in self._flying]
        queues = [queue for queue in self.queues.values() if queue.rows]
        since_s = [row.time_s for row in flying]
        since_s += [self._memory[queue.ids[0]].time_s for queue in queues if queue.ids]
        since_s += [queue.first_s for queue in queues if queue.beyond]
        rows = len(flying) + sum(queue.rows for queue in queues)
        size = sum(row.size for row in flying) + sum(queue.bytes for queue in queues)
        return rows, size, min(since_s, default=None)

    # Rows come, wait for their word, go out, and are gone.

    def put(self, row: OutboxRow) -> None:
        """Take a row, or release the one that was staged; what is too much goes, the oldest values first."""
        staged = self._staged.pop((row.key, row.payload), None)
        if staged is not None:
            self.release(staged)
        else:
            self._memory[row.id] = row
            self._unwritten[row.id] = False
            self._enqueue(row)

    def hold(self, row: OutboxRow) -> None:
        """Have a row stored that waits to be released."""
        self._memory[row.id] = row
        self._held.add(row.id)
        self._unwritten[row.id] = False

    def stage(self, row: OutboxRow) -> None:
        """Hold a row that somebody else stores, until the same is put."""
        self._memory[row.id] = row
        self._held.add(row.id)
        self._staged[row.key, row.payload] = row.id

    def is_to_be_stored(self, row: OutboxRow) -> bool:
        """Return whether a staged row must be in the table: the broker does not have it; from any thread."""
        return row.id in self._memory

    def holds(self, id_: int) -> bool:
        """Return whether a row is held."""
        return id_ in self._held

    def release(self, id_: int) -> None:
        """Let a held row be sent."""
        self._held.remove(id_)
        row = self._memory[id_]
        if row.key:  # whether it could be stored is not known here: it is stored again, which changes nothing
            self._unwritten[row.id] = True
        self._enqueue(row)

    def cancel(self, id_: int) -> None:
        """Remove a row if it is held: the broker has its message."""
        if id_ in self._held:
            self._held.remove(id_)
            self._have_deleted(self._memory.pop(id_), is_lost=False)

    def first(self, rank: Rank) -> OutboxRow | None:
        """Return the row of a rank that comes next; None when there is none, or it is being read."""
        queue = self.queues[rank]
        is_known = queue.is_next_here or self.is_table_away()
        return self._memory[queue.ids[0]] if queue.ids and is_known else None

    def take(self, row: OutboxRow) -> None:
        """Remove what `first` returned, until it is done or given back."""
        self.queues[row.rank].remove(row)
        self._flying.add(row.id)

    def take_history(self, most: int) -> list[OutboxRow]:
        """Remove the next values of one run and starter, until they are done or given back."""
        first = self.first(Rank.VALUE)
        if first is None:
            return []
        queue = self.queues[Rank.VALUE]
        upto = queue.upto if queue.is_next_here else HIGHEST
        near = (self._memory[id_] for id_ in queue.ids[:LOOKAHEAD] if id_ <= upto)
        batch = [row for row in near if (row.topic, row.boot) == (first.topic, first.boot)][:most]
        for row in batch:
            self.take(row)
        return batch

    def done(self, rows: Iterable[OutboxRow]) -> None:
        """Note that the broker has acknowledged what was taken."""
        for row in rows:
            self._flying.remove(row.id)
            self._forget(row, is_lost=False)
            if row.key in self._needed:
                self._needed[row.key] = row.id

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

    def give_back(self) -> None:
        """Put everything that was taken and not done back into its place."""
        flown = [self._memory[id_] for id_ in sorted(self._flying)]
        self._flying.clear()
        for row in flown:
            self.queues[row.rank].add(row)
            self._leave_to_table(row)

    # What is to be written.

    def batches(self) -> list[Batch]:
        """Return what is to be written next: what is to be deleted, then what is new.

        While there are more events than that, the table keeps losses whose event it may not have yet.
        """
        found: list[Batch] = []
        needed = frozenset(self._needed.values())
        gone = dict(islice((each for each in self._gone.items() if each[0] not in needed), MOST_DELETED))
        has_lost = any(each.is_lost for each in gone.values())
        if gone:
            self._gone = {id_: each for id_, each in self._gone.items() if id_ not in gone}
            found.append(Batch((), gone, self.losses.with_declared() if has_lost else None))
        if self._unwritten or has_lost or self.losses.differ_from_stored(self.losses.pending):
            ids = [id_ for id_ in self._unwritten if self._memory[id_].rank is not Rank.VALUE]
            values = (id_ for id_ in self._unwritten if self._memory[id_].rank is Rank.VALUE)
            has_events = len(ids) <= MOST_ROWS
            ids = [*ids, *islice(values, MOST_VALUES)][:MOST_ROWS]
            self._unwritten.update(dict.fromkeys(ids, True))
            rows = [self.in_utc(self._memory[id_]) for id_ in ids]
            losses = self.losses.pending if has_events else self.losses.with_declared()
            is_unsaved = has_lost or self.losses.differ_from_stored(losses)
            found.append(Batch(rows, losses=losses if is_unsaved else None, has_events=has_events))
        return found

    def written(self, batch: Batch) -> None:
        """Note that a batch is in the table."""
        if batch.losses is not None:
            self.losses.note_stored(batch.losses)
        if batch.has_events:
            self.losses.note_events_stored()
        for row in batch.rows:
            if self._unwritten.pop(row.id, False):
                self._leave_to_table(self._memory[row.id])

    def unwritten(self, batch: Batch) -> None:
        """Note that a batch could not be written, as far as is known."""
        self._gone = {**batch.gone, **self._gone}
        if batch.losses is not None:
            self.losses.note_stored(None)

    def in_utc(self, row: OutboxRow) -> OutboxRow:
        """Return a row as the table has it."""
        return row._replace(time_s=self._utc_of(row.time_s))

    # What the table says.

    def expect_table(self) -> None:
        """Take it that there is a table, whose rows of earlier runs come first."""
        for queue in self.queues.values():
            queue.expect_table()

    def recall(self, totals: Mapping[Rank, Total], losses: Sequence[Loss]) -> None:
        """Begin with what earlier runs have left behind; times are the steady clock's, of losses UTC."""
        self.losses.recall(losses)
        for rank, queue in self.queues.items():
            if rank in totals:
                queue.recall(totals[rank])
            else:
                queue.bring((), HIGHEST, 0.0)

    def wanted(self, *, is_sending: bool) -> list[tuple[Rank, int]]:
        """Return what is to be read, in order to be sent or given up: the ranks, and after which row."""
        wanting = [(rank, queue.upto) for rank, queue in self.queues.items() if queue.wants_page]
        return wanting if is_sending or self._excess() else []

    def page(self, rank: Rank, page: OutboxPage) -> None:
        """Take what was read; the times of its rows are the steady clock's."""
        queue = self.queues[rank]
        rows = [row for row in page.rows if row.id not in self._memory and row.id not in self._gone]
        for row in rows:
            self._memory[row.id] = row
            self._bytes += row.size
        for id_ in page.damaged:
            queue.lose_beyond(1, 0)  # its size is not known: the last page sets the sum right
            self._gone[id_] = Gone(rank, is_lost=True)
            self._note_lost(DAMAGED, rank, 1, queue.first_s, queue.last_s)
        upto = HIGHEST if page.is_last else page.upto
        queue.bring((row.id for row in rows), upto, page.rows[-1].time_s if page.rows else 0.0)
        if page.is_last:
            self._lose_beyond(rank)
        self._make_room()

    def lose_table(self) -> None:
        """Declare what was only in the table, which is a new one; all the rest is written again."""
        self._gone.clear()
        for rank, queue in self.queues.items():
            self._lose_beyond(rank)
            queue.bring((), HIGHEST, 0.0)
        others = (
            self._memory.keys() - self._staged.values()
        )  # what is staged is stored with its command's row
        self._unwritten = dict.fromkeys(sorted(others), True)
        self.losses.note_stored(None)
        self.on_work()

    # Inside.

    def _enqueue(self, row: OutboxRow) -> None:
        self._bytes += row.size
        self.queues[row.rank].add(row)
        self._leave_to_table(row)
        self._make_room()

    def _make_room(self) -> None:
        """Give up the oldest of the lowest rank, as long as there is too much and it is at hand."""
        while (reason := self._excess()) and (victim := self._victim(reason)) is not None:
            self.queues[victim.rank].remove(victim)
            self._forget(victim, is_lost=True)
            self._note_lost(reason, victim.rank, 1, victim.time_s, victim.time_s)

    def _excess(self) -> str:
        """Return of what there is too much: of rows in memory, or of all that wait."""
        here = Bounds(len(self._memory) - len(self._held), self._bytes)
        queues = self.queues.values()
        all_ = Bounds(sum(queue.rows for queue in queues), sum(queue.bytes for queue in queues))
        for reason, there_is in ((MEMORY_FULL, here), (DISK_FULL, all_)):
            bound = self._bounds[reason]
            if there_is.rows > bound.rows or there_is.bytes > bound.bytes:
                return reason
        return ""

    def _victim(self, reason: str) -> OutboxRow | None:
        """Return the oldest row of the lowest rank that has any; None while that is being read."""
        for rank, queue in self.queues.items():
            if reason == DISK_FULL and queue.rows:
                return self.first(rank)
            if queue.ids:
                return self._memory[queue.ids[0]]
        return None

    def _leave_to_table(self, row: OutboxRow) -> None:
        """Forget a row that the table has, unless it is held, in flight or within the window."""
        queue = self.queues[row.rank]
        is_needed = row.id in self._unwritten or row.id in self._held or row.id in self._flying
        if row.id > queue.upto and not is_needed:
            queue.leave(row)
            del self._memory[row.id]
            self._bytes -= row.size

    def _forget(self, row: OutboxRow, *, is_lost: bool) -> None:
        """Let go of a row that is in no place any more."""
        del self._memory[row.id]
        self._bytes -= row.size
        self._have_deleted(row, is_lost=is_lost)

    def _have_deleted(self, row: OutboxRow, *, is_lost: bool) -> None:
        """Have the table delete a row that it has, or may have."""
        if self._unwritten.pop(row.id, True):
            self._gone[row.id] = Gone(row.rank, is_lost)

    def _note_lost(self, reason: str, rank: Rank, rows: int, first_s: float, last_s: float) -> None:
        self.losses.add(Loss(reason, rank, rows, self._utc_of(first_s), self._utc_of(last_s)))

    def _lose_beyond(self, rank: Rank) -> None:
        """Declare what the table should have and has not."""
        queue = self.queues[rank]
        if queue.beyond > 0:  # less after a page of the table before, of which all was declared lost
            self._note_lost(STORE_LOST, rank, queue.beyond, queue.first_s, queue.last_s)
        queue.lose_beyond(queue.beyond, queue.bytes - sum(self._memory[id_].size for id_ in queue.ids))
