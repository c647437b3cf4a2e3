"""What the history publishes: nothing that a kill could undo, and nothing that a kill could swallow.

1. A start or a trip is counted at once, and published when the file has it, or cannot have it. So are values
   that the history publishes meanwhile: the number of starts is never published before the start is stored.
2. In the transaction that stores it there is a mark: the broker has not had it yet. The mark goes when the
   broker has acknowledged the record.
3. The next run publishes what is still marked once more, word for word, unless the outbox has it on its disk.
   Its id, and its topic with `boot` and `seq`, say that it is the same.
"""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial

from gateway.contract import Record, Sink, StartRecord, TripRecord, ValueRecord
from gateway.errors import StoreError
from gateway.plugins.history.service.starts import CURVE, START
from gateway.plugins.history.service.trips import KIND as TRIP
from gateway.storage.history import HistoryStore
from gateway.storage.history_table import HistoryRow
from gateway.system.clock import Clock

log = logging.getLogger(__name__)

UNDELIVERED = "undelivered"  # kind of the marks in the store; the id is "<kind of the record>/<its id>"
MOST_MARKS = 20  # of each starter: as many starts as have their curves
HELD_AT_MOST_S = 2.0  # a disk that is busy for longer is not waited for

PublishAgain = Callable[[Sequence[Record]], None]


class Delivery:
    """Implements `Sink` for the parts of all starters; all calls on the app's loop."""

    def __init__(
        self,
        sink: Sink,
        store: HistoryStore,
        *,
        boot: str,
        clock: Clock,
        count: Callable[[StartRecord | TripRecord], None],
        publish_again: PublishAgain,
    ) -> None:
        self._sink = sink
        self._store = store
        self._boot = boot
        self._clock = clock
        self._count = count
        self._publish_again = publish_again
        self._held: deque[tuple[int, Record]] = deque()  # by the transaction that they wait for
        self._transaction = 0  # the one that is being made

    def put(self, record: Record) -> None:
        """Publish a record; a start or a trip, and values after it, when the file has it."""
        if isinstance(record, StartRecord | TripRecord):
            self._hold(record)
            self._mark(record)
            self._count(record)
        elif isinstance(record, ValueRecord) and self._held:
            self._hold(record)
        else:
            self._sink.put(record)

    def release(self) -> None:
        """Publish everything that waits for the disk."""
        self._release(self._transaction)

    def delivered(self, key: str) -> None:
        """Note that the broker has acknowledged what has this key; those of others are ignored."""
        starter, _, id_ = key.partition(":")
        if id_:
            self._store.drop(starter, UNDELIVERED, id_)

    async def publish_left(self, starter: str, rows: Sequence[HistoryRow]) -> None:
        """Publish again what earlier runs have stored, but perhaps not delivered; `rows` have the marks."""
        marks = [row.id for row in rows if row.kind == UNDELIVERED]
        left = [await self._stored(starter, id_) for id_ in marks if not self._is_ours(id_)]
        records = [record for record in left if record is not None]
        if records:
            log.info("starter=%s records that the broker may not have had: %d", starter, len(records))
            self._publish_again(records)

    def _hold(self, record: Record) -> None:
        if not self._held or self._held[-1][0] != self._transaction:
            # What is stored with it is put before this piece of work ends, and is then with the disk.
            asyncio.get_running_loop().call_soon(self._wait)
        self._held.append((self._transaction, record))

    def _wait(self) -> None:
        """Publish what is held so far when the file has it."""
        release = partial(self._release, self._transaction)
        self._transaction += 1
        asyncio.get_running_loop().call_later(HELD_AT_MOST_S, release)
        self._store.when_stored(release)

    def _release(self, upto: int) -> None:
        while self._held and self._held[0][0] <= upto:
            self._sink.put(self._held.popleft()[1])

    def _mark(self, record: StartRecord | TripRecord) -> None:
        starter, _, id_ = record.key.partition(":")
        utc_s = self._clock.utc_s()
        self._store.put(starter, UNDELIVERED, id_, time_s=utc_s, data={}, limit=MOST_MARKS)

    def _is_ours(self, id_: str) -> bool:
        """Return whether a mark is of this run: its record waits in this run's outbox."""
        return id_.partition("/")[2].startswith(f"{self._boot}-")

    async def _stored(self, starter: str, mark: str) -> Record | None:
        """Return a record as it was published; None, and no mark any more, when it is not stored whole."""
        kind, _, id_ = mark.partition("/")
        try:
            row = await self._store.row(starter, kind, id_)
            curve = await self._store.row(starter, CURVE, id_) if kind == START else None
        except StoreError:
            return None  # the mark stays for the next run
        if row is not None and kind == TRIP:
            return TripRecord(starter=starter, id=id_, data=row.data)
        if row is not None and curve is not None:
            return StartRecord(starter=starter, id=id_, data={**row.data, "samples": curve.data})
        self._store.drop(starter, UNDELIVERED, mark)
        return None
