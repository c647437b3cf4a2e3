"""How a start or a trip gets to the broker and into the history, whatever is killed.

1. It is stored for the broker first: from then on it is certain. So it is counted, published and handed to
   the history after that, or when the disk takes too long: no number of starts is published that a kill
   takes back.
2. Its row in the outbox is the record, and stays until the history has it too.
3. What earlier runs have left in the outbox, and the history lacks, it takes over at the start, by its id.
"""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Awaitable, Callable, Iterable, Mapping, Sequence
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass
from functools import partial

from gateway.contract import Record, RecordWriter, StartRecord, TripRecord, read_record
from gateway.store import HistoryRow, HistoryStore
from gateway.system.supervised import on_this_loop

log = logging.getLogger(__name__)

HELD_AT_MOST_S = 2.0  # a disk that is busy for longer is not waited for
KINDS: Mapping[str, type[StartRecord | TripRecord]] = {"start": StartRecord, "trip": TripRecord}  # of rows too


@dataclass(frozen=True, slots=True)
class StoredRecords:
    """What is stored for the broker, by the keys of the records."""

    keep: Callable[[Record], Future[None]]  # stores one; once it is put, it is sent
    payloads: Callable[[Sequence[str]], Awaitable[Mapping[str, bytes]]]  # StoreError
    let_go: Callable[[str], None]  # one need not stay any more when the broker has it


class Delivery:
    """The way to the broker and to the file, for the histories of all motors; all calls on the app's loop."""

    def __init__(self, records: RecordWriter, store: HistoryStore, outbox: StoredRecords) -> None:
        self.records = records
        self.store = store
        self._outbox = outbox
        self._pending: deque[tuple[Record, Callable[[], None]]] = deque()  # on their way into the outbox
        self._taken = 0  # from there, ever
        self._latest: Future[None] | None = None
        self._left: list[str] = []  # keys of what earlier runs have not seen delivered

    def publish(self, record: StartRecord | TripRecord, keep: Callable[[], None]) -> None:
        """Publish a start or a trip; `keep` has it counted and stored, as soon as it is certain."""
        self._pending.append((record, keep))
        release = partial(self._release, self._taken + len(self._pending))
        self._latest = self._outbox.keep(record)
        self._latest.add_done_callback(on_this_loop(lambda _: release()))
        asyncio.get_running_loop().call_later(HELD_AT_MOST_S, release)

    def release(self) -> None:
        """Publish everything that waits for the disk."""
        self._release(self._taken + len(self._pending))

    async def settle(self) -> None:
        """Publish everything, when the disk has it or takes too long."""
        if self._latest is not None:
            with suppress(TimeoutError):
                async with asyncio.timeout(HELD_AT_MOST_S):
                    await asyncio.gather(asyncio.wrap_future(self._latest), return_exceptions=True)
        self.release()

    def note_stored(self, rows: Iterable[HistoryRow]) -> None:
        """Let the outbox delete what the history has."""
        for row in rows:
            if row.kind in KINDS:
                self._outbox.let_go(_key(row.starter, row.kind, row.id))

    def note_left(self, keys: Iterable[str], starters: Iterable[str]) -> Sequence[str]:
        """Note what earlier runs have left in the outbox; return which of it must stay until it is stored."""
        wanted = {f"{starter}:{kind}" for starter in starters for kind in KINDS}
        of_ours = ((key, *key.partition("/")) for key in keys)
        own = f"{self.records.boot}-"
        self._left = [key for key, of, _, id_ in of_ours if of in wanted and not id_.startswith(own)]
        return self._left

    async def take_left(self, starter: str) -> list[StartRecord | TripRecord]:
        """Return what of that the history of a starter lacks, the oldest first of each kind; StoreError."""
        records: list[StartRecord | TripRecord] = []
        for kind, kind_of_record in KINDS.items():
            begin = _key(starter, kind, "")
            ids = [key.removeprefix(begin) for key in self._left if key.startswith(begin)]
            lacking = [_key(starter, kind, id_) for id_ in await self.store.lacking(starter, kind, ids)]
            payloads = await self._outbox.payloads(lacking) if lacking else {}
            for key in (_key(starter, kind, id_) for id_ in ids):
                try:
                    records.append(read_record(kind_of_record, payloads[key], starter=starter))
                except (KeyError, ValueError):
                    self._outbox.let_go(key)
        return records

    def _release(self, upto: int) -> None:
        while self._pending and self._taken < upto:
            record, keep = self._pending.popleft()
            self._taken += 1
            self.records.put(record)
            try:
                keep()
            except Exception:
                log.exception("the history has lost the record %s", record.key)


def _key(starter: str, kind: str, id_: str) -> str:
    """Return the key of a record, as the record gives it."""
    return f"{starter}:{kind}/{id_}"
