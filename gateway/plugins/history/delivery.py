"""Where the histories of all motors publish and store: nothing that a kill could undo or swallow.

1. A start or a trip is counted at once, and published when the file has it, or cannot have it. So are values
   that the history publishes meanwhile: the number of starts is never published before the start is stored.
2. In the transaction that stores it there is a copy, marked as not delivered. It goes when the broker has
   acknowledged the record.
3. The next run publishes the copies that are left once more, word for word, unless the outbox has them on its
   disk. Id, `boot` and `seq` say that it is the same record.
"""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Callable, Coroutine, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Any

from gateway.contract import Record, RecordWriter, StartRecord, TripRecord, ValueRecord, read_stored
from gateway.errors import StoreError
from gateway.storage.history import HistoryStore
from gateway.storage.history_table import HistoryRow

log = logging.getLogger(__name__)

UNDELIVERED = "undelivered"  # kind of the copies in the store; the id is "<kind of the record>/<its id>"
MOST_COPIES = 20  # of each starter: as many starts as have their curves
HELD_AT_MOST_S = 2.0  # a disk that is busy for longer is not waited for
KINDS: Mapping[str, type[StartRecord | TripRecord]] = {"start": StartRecord, "trip": TripRecord}

PublishAgain = Callable[[Sequence[Record]], None]


class Delivery:
    """A sink of records, and the store by starter; all calls on the app's loop."""

    def __init__(
        self,
        records: RecordWriter,
        store: HistoryStore,
        *,
        count: Callable[[StartRecord | TripRecord], None],
        publish_again: PublishAgain,
    ) -> None:
        self.records = replace(records, sink=self)
        self._sink = records.sink
        self._store = store
        self._count = count
        self._publish_again = publish_again
        self._held: deque[tuple[int, Record]] = deque()  # by the start or trip that they wait for
        self._number = 0  # of starts and trips so far
        self._tasks: set[asyncio.Task[None]] = set()

    def put(self, record: Record) -> None:
        """Publish a record; a value after a start or trip only when the file has that."""
        if self._held and isinstance(record, ValueRecord):
            self._held.append((self._number, record))
        else:
            self._sink.put(record)

    def publish(self, record: StartRecord | TripRecord) -> None:
        """Count a start or trip now, and publish it when the file has what the caller stores of it next."""
        self._number += 1
        self._held.append((self._number, record))
        starter, _, id_ = record.key.partition(":")
        self.store(starter, UNDELIVERED, id_, record.fields(), limit=MOST_COPIES)
        self._count(record)
        release = partial(self._release, self._number)
        loop = asyncio.get_running_loop()  # by its next step the caller has handed over what it stores
        loop.call_soon(loop.call_later, HELD_AT_MOST_S, release)
        loop.call_soon(self._store.when_stored, release)

    def store(
        self,
        starter: str,
        kind: str,
        id_: str,
        data: Mapping[str, Any],
        *,
        limit: int,
        is_urgent: bool = False,
    ) -> None:
        """Store a row of a starter; see `HistoryStore.put`."""
        utc_s = self.records.clock.utc_s()
        self._store.put(starter, kind, id_, time_s=utc_s, data=data, limit=limit, is_urgent=is_urgent)

    def copy(self, starter: str, kind: str, id_: str, to_kind: str) -> None:
        """Store a row once more, as the only one of another kind."""

        async def work() -> None:
            with suppress(StoreError):
                row = await self._store.row(starter, kind, id_)
                if row is not None:
                    self.store(starter, to_kind, id_, row.data, limit=1, is_urgent=True)

        self.begin(work())

    def begin(self, work: Coroutine[Any, Any, None]) -> None:
        """Have something done beside everything else, until `close`."""
        task = asyncio.get_running_loop().create_task(work, name="history")
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def delivered(self, key: str) -> None:
        """Drop the copy of what the broker has acknowledged; keys of other records are ignored."""
        starter, _, id_ = key.partition(":")
        if id_:
            self._store.drop(starter, UNDELIVERED, id_)

    def publish_left(self, starter: str, rows: Sequence[HistoryRow]) -> None:
        """Publish again what earlier runs have stored, but perhaps not delivered."""
        left: list[Record] = []
        for row in rows:
            kind, _, id_ = row.id.partition("/")
            if row.kind != UNDELIVERED or id_.startswith(f"{self.records.boot}-"):
                continue  # this run's own waits in its outbox
            try:
                left.append(read_stored(KINDS[kind], row.data, starter=starter))
            except (KeyError, ValueError):
                self._store.drop(starter, UNDELIVERED, row.id)
        if left:
            log.info("starter=%s records that the broker may not have had: %d", starter, len(left))
            self._publish_again(left)

    def release(self) -> None:
        """Publish everything that waits for the disk."""
        self._release(self._number)

    def close(self) -> None:
        """End what was begun."""
        for task in self._tasks:
            task.cancel()

    def _release(self, upto: int) -> None:
        while self._held and self._held[0][0] <= upto:
            self._sink.put(self._held.popleft()[1])
