"""The common means of a motor's history, and the way of a start or a trip to the broker and the file.

1. It is stored for the broker first: from then on it is certain. So it is counted, published and handed to
   the history after that, or when the disk takes too long: no number of starts is published that a kill
   takes back.
2. Its row in the outbox is the record, and stays until the history has it too.
3. What earlier runs have left in the outbox, and the history lacks, it stores at the start, by its id.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable, Iterable, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple, TypeVar

from gateway.contract import Record, RecordWriter, StartRecord, TripRecord, read_record
from gateway.starters import Readings, StarterSetup
from gateway.store import HistoryRow, HistoryStore
from gateway.system.supervised import on_this_loop

log = logging.getLogger(__name__)

HELD_AT_MOST_S = 2.0  # a disk that is busy for longer is not waited for
MOST_EARLY = 20  # records of a starter that wait in memory for it to be read
KINDS = {StartRecord: "start", TripRecord: "trip"}  # of rows, and in keys

T = TypeVar("T", StartRecord, TripRecord)
Rows = Mapping[str, Any]  # of a starter, by code


class Past(NamedTuple):
    """The rows that earlier runs have stored of a motor, and those only in the outbox; the oldest first."""

    rows: Sequence[HistoryRow]
    starts: Sequence[StartRecord]
    trips: Sequence[TripRecord]


class Part:
    """A part of one motor's history, which does nothing unless it says so. All calls on the app's loop."""

    def take_readings(self, readings: Readings) -> None:
        """Record what was just read."""

    def put(self, record: Record) -> None:
        """Record what was just published."""

    def note_fault_data(self, at_fault: Rows, history: Sequence[Rows]) -> None:
        """Record what the starter says of a trip."""

    def note_start_data(self, rows: Rows) -> None:
        """Record what the starter has stored of the start that has just ended."""

    def note_own_rows(self, rows: Mapping[str, float]) -> None:
        """Record what the starter has counted itself, and its settings; by code, just read."""

    def restore(self, past: Past) -> None:
        """Go on from earlier runs; once."""

    def reconfigure(self, setup: StarterSetup) -> None:
        """Go on with another machine, or with other polls, under the same name: what was under way ends."""

    def close(self) -> None:
        """End what is under way and store what must outlive the gateway: it ends, or the starter is gone."""


@dataclass(frozen=True, slots=True)
class StoredRecords:
    """The records stored for the broker, by their keys."""

    keep: Callable[[Record], Future[None]]  # stores one; once it is put, it is sent
    payloads: Callable[[Sequence[str]], Awaitable[Mapping[str, bytes]]]  # StoreError
    let_go: Callable[[str], None]  # one need not stay any more when the broker has it


class Delivery:
    """The way to the broker and to the file, for the histories of all motors; all calls on the app's loop."""

    def __init__(self, records: RecordWriter, store: HistoryStore, outbox: StoredRecords) -> None:
        self.records = records
        self.store = store
        self._outbox = outbox
        self._pending: dict[str, tuple[StartRecord | TripRecord, Callable[[], None]]] = {}  # not certain yet
        self._left: list[str] = []  # keys of what earlier runs have not seen delivered
        self._early: dict[str, list[Callable[[], None]]] = {}  # by starter that is not read

    def publish(self, record: StartRecord | TripRecord, keep: Callable[[], None]) -> None:
        """Publish a start or a trip as soon as it is certain; `keep` then has it counted and stored.

        Before its starter is read, `keep` waits for that: it comes after what earlier runs have left.
        """
        self._pending[record.key] = (record, keep)
        release = partial(self._release, record.key)
        self._outbox.keep(record).add_done_callback(on_this_loop(lambda _: release()))
        asyncio.get_running_loop().call_later(HELD_AT_MOST_S, release)

    def release(self) -> None:
        """Publish everything that waits for the disk."""
        for key in list(self._pending):
            self._release(key)

    def note_stored(self, row: HistoryRow) -> None:
        """Let the outbox delete what the history has."""
        if row.kind in KINDS.values():
            self._outbox.let_go(_key(row.starter, row.kind, row.id))

    def note_left(self, keys: Iterable[str], starters: Iterable[str]) -> Sequence[str]:
        """Note what earlier runs have left in the outbox; return which of it must stay until it is stored."""
        wanted = {f"{starter}:{kind}" for starter in starters for kind in KINDS.values()}
        of_ours = ((key, *key.partition("/")) for key in keys)
        own = f"{self.records.boot}-"
        self._left = [key for key, of, _, id_ in of_ours if of in wanted and not id_.startswith(own)]
        return self._left

    async def take_left(self, starter: str, kind: type[T]) -> list[T]:
        """Return what of that the history of a starter lacks, the oldest first; StoreError.

        It came after the newest that is stored: the history once had what came before that.
        """
        begin = _key(starter, KINDS[kind], "")
        ids = [key.removeprefix(begin) for key in self._left if key.startswith(begin)]
        stored = {row.id for row in await self.store.rows(starter, (KINDS[kind],))} if ids else ()
        known = max((number for number, id_ in enumerate(ids, 1) if id_ in stored), default=0)
        lacking = [begin + id_ for id_ in ids[known:]]
        payloads = await self._outbox.payloads(lacking) if lacking else {}
        records: list[T] = []
        for id_ in ids:
            try:
                records.append(read_record(kind, payloads[begin + id_], starter=starter))
            except (KeyError, ValueError):
                self._outbox.let_go(begin + id_)
        return records

    def expect(self, starter: str) -> None:
        """Keep nothing of a starter until it is read."""
        self._early[starter] = []

    def go_on(self, starter: str) -> None:
        """Keep what has come since then, and all that comes."""
        for keep in self._early.pop(starter, ()):
            _guarded(keep)

    def _release(self, key: str) -> None:
        record, keep = self._pending.pop(key, (None, None))
        if record is None or keep is None:
            return
        self.records.put(record)
        early = self._early.get(record.starter)
        if early is None:
            _guarded(keep)
        else:
            early.append(keep)
            del early[:-MOST_EARLY]


def _guarded(keep: Callable[[], None]) -> None:
    try:
        keep()
    except Exception:  # a part's bug
        log.exception("the history has lost a record")


def _key(starter: str, kind: str, id_: str) -> str:
    """Return the key of a record, as the record gives it."""
    return f"{starter}:{kind}/{id_}"
