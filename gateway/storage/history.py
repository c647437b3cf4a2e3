"""The file of the motors' history and its thread: starts, curves, months, baselines, trips, counters.

A file of its own, because neither the ledger's commands nor the outbox must wait for it. What a finished
record consists of is written at once, in one transaction; everything else is collected for a few seconds.
While the disk is away rows wait in memory, a bounded number of them. Other processes may read the file
meanwhile.
"""

from __future__ import annotations

import asyncio
from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from functools import partial
from pathlib import Path
from typing import Any

from gateway.errors import UnstorableError
from gateway.storage.history_table import GONE, HistoryRow, HistoryTable
from gateway.store import HISTORY, HISTORY_FILE, RETRY_S, Connection, News, OnNews, Store, read_file
from gateway.system.supervised import on_this_loop

MAX_BYTES = 128 * 2**20  # far above what its rows' limits allow; only a guard
COLLECT_S = 5.0  # between transactions in which no record is finished
MOST_UNSAVED = 500  # rows in memory while the disk is away; the oldest are lost first

_Key = tuple[str, str, str]  # starter, kind, id


class HistoryStore:
    """All calls on the app's loop; none waits for the disk but `load`, `row` and `close`."""

    def __init__(
        self,
        state_dir: Path,
        on_news: OnNews,
        *,
        retry_s: float = RETRY_S,
        collect_s: float = COLLECT_S,
    ) -> None:
        self._table = HistoryTable()
        self._on_news = on_news
        self._collect_s = collect_s
        self._store = Store(state_dir / HISTORY_FILE, HISTORY, max_bytes=MAX_BYTES, retry_s=retry_s)
        self._waiting: OrderedDict[_Key, HistoryRow] = OrderedDict()  # not handed to the thread yet
        self._timer: asyncio.TimerHandle | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._is_away = False
        self._latest: Future[None] | None = None  # the latest transaction
        self.lost_rows = 0  # that memory could not hold

    def start(self) -> None:
        """Begin; the file is opened in the thread, and `on_news` is called on this loop."""
        self._loop = asyncio.get_running_loop()
        self._store.start(on_this_loop(self._report))

    def put(
        self,
        starter: str,
        kind: str,
        id_: str,
        *,
        time_s: float,
        data: Mapping[str, Any],
        limit: int,
        is_urgent: bool = False,
    ) -> None:
        """Store an object in place of the one of this id; the newest `limit` of its kind stay.

        What is urgent is written now, together with everything put before it; all else within a few seconds.
        """
        self._add(HistoryRow(starter, kind, id_, time_s, data, limit))
        if is_urgent:
            self.flush()
        elif self._timer is None and self._loop is not None:
            self._timer = self._loop.call_later(self._collect_s, self.flush)

    def drop(self, starter: str, kind: str, id_: str) -> None:
        """Delete the object of this id, if there is one, within a few seconds."""
        self.put(starter, kind, id_, time_s=0.0, data={}, limit=GONE)

    def when_stored(self, call: Callable[[], None]) -> None:
        """Call once what was handed to the disk up to now is on it, or cannot be."""
        if self._latest is None or self._latest.done():
            call()
        else:
            self._latest.add_done_callback(on_this_loop(lambda _: call()))

    def flush(self) -> None:
        """Hand everything that waits to the thread, as one transaction."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if not self._waiting or self._loop is None or self._is_away:
            return
        rows = tuple(self._waiting.values())
        self._waiting.clear()
        future = self._store.submit(partial(self._table.put, rows=rows))
        future.add_done_callback(on_this_loop(partial(self._when_done, rows)))
        self._latest = future

    async def load(
        self, starters: Sequence[str] | None = None, kinds: Sequence[str] = ()
    ) -> dict[str, list[HistoryRow]]:
        """Return what is stored of each starter (None: of all), the oldest first; StoreError.

        What was put before this call is in it, if the disk has it.
        """
        self.flush()
        work = partial(self._table.rows, starters=starters, kinds=kinds)
        found: dict[str, list[HistoryRow]] = {}
        for row in await asyncio.wrap_future(self._store.submit(work, is_flushed=False)):
            found.setdefault(row.starter, []).append(row)
        return found

    async def row(self, starter: str, kind: str, id_: str) -> HistoryRow | None:
        """Return one row; None when there is none; StoreError."""
        self.flush()
        work = partial(self._table.row, starter=starter, kind=kind, id_=id_)
        return await asyncio.wrap_future(self._store.submit(work, is_flushed=False))

    async def close(self, within_s: float) -> bool:
        """Close the file when all is written; return whether there was time for it."""
        self.flush()
        return await asyncio.to_thread(self._store.close, within_s=within_s)

    def _add(self, row: HistoryRow) -> None:
        key = (row.starter, row.kind, row.id)
        self._waiting.pop(key, None)
        self._waiting[key] = row
        if len(self._waiting) > MOST_UNSAVED:
            self._waiting.popitem(last=False)
            self.lost_rows += 1

    def _when_done(self, rows: Sequence[HistoryRow], future: Future[None]) -> None:
        """Have rows that could not be written wait again, before those that came later."""
        error = future.exception()
        if error is None or isinstance(error, UnstorableError):
            return
        later = list(self._waiting.values())
        self._waiting.clear()
        for row in (*rows, *later):
            self._add(row)

    def _report(self, news: News, text: str) -> None:
        self._is_away = news is News.AWAY
        if news is News.OPEN:
            self.flush()
        self._on_news(news, text)


def read_history(state_dir: Path, starter: str) -> list[HistoryRow]:
    """Return what is stored of a starter, the oldest first, beside a gateway that runs or not; StoreError."""

    def work(connection: Connection) -> list[HistoryRow]:
        return HistoryTable().rows(connection, starters=[starter])

    return read_file(state_dir / HISTORY_FILE, HISTORY, work)
