"""The motors' history: starts, curves, months, baselines, trips, settings and counters, in a file of its own.

The file has a thread of its own too, so that neither commands nor the outbox wait for it. A row is a JSON
object of a kind, of which the newest few stay for each starter. It is compressed (a curve of 300 samples
takes about 4 KB); one that cannot be unpacked is left out. The order of rows is that in which they came
first, whatever the wall clock said. While the disk is away rows wait in memory, a bounded number of them.
"""

from __future__ import annotations

import asyncio
import json
import time
import zlib
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from gateway.store.database import Connection, read_file
from gateway.store.import_0_2 import import_files
from gateway.store.schema import HISTORY, HISTORY_FILE
from gateway.store.worker import BEHIND_S, OnNews, Store
from gateway.system.supervised import on_this_loop

COLLECT_S = 5.0  # between transactions in which nothing is urgent
MOST_UNSAVED = 1000  # rows in memory while the disk is away; the oldest are lost first

CURVES = ("baseline_curve", "curve")  # kinds of samples, by the id of their start

_OF_STARTER = "SELECT kind, id, data FROM history WHERE starter = ?"
_PUT = """
    INSERT INTO history (starter, kind, id, time_s, data) VALUES (?, ?, ?, ?, ?)
    ON CONFLICT (starter, kind, id) DO UPDATE SET time_s = excluded.time_s, data = excluded.data
"""
_COPY = """
    INSERT OR REPLACE INTO history (starter, kind, id, time_s, data)
    SELECT starter, ?, id, time_s, data FROM history WHERE starter = ? AND kind = ? AND id = ?
"""
_PRUNE = """
    DELETE FROM history WHERE starter = ? AND kind = ? AND number <=
    (SELECT number FROM history WHERE starter = ? AND kind = ? ORDER BY number DESC LIMIT 1 OFFSET ?)
"""
_WINDOW_BITS = 13  # 8 KiB instead of 32: less memory, hardly more on the disk


class HistoryRow(NamedTuple):
    """The data of a starter under a kind and an id, in place of any that were there."""

    starter: str
    kind: str
    id: str
    data: Mapping[str, Any]
    limit: int = 1  # so many of this kind stay, the newest


class HistoryStore:
    """All calls on the app's loop; only `rows` and `close` wait for the disk."""

    def __init__(self, path: Path) -> None:
        prepare = partial(import_files, path.parent)
        self._store = Store(path, HISTORY, most_waiting=MOST_UNSAVED, prepare=prepare)
        self._on_stored: Callable[[HistoryRow], None] = lambda _: None

    def start(self, on_news: OnNews, on_stored: Callable[[HistoryRow], None]) -> None:
        """Begin; the file is opened in the thread. `on_stored` gets each row that is on the disk."""
        self._on_stored = on_stored
        self._store.start(on_this_loop(on_news))

    def put(self, row: HistoryRow, *, is_urgent: bool = False) -> None:
        """Store a row; an urgent one soon, with all that was put before, others within seconds."""
        within_s = BEHIND_S if is_urgent else COLLECT_S
        done = self._store.submit(partial(_write, row=row), key=("history", *row[:3]), within_s=within_s)
        done.add_done_callback(on_this_loop(partial(self._note_stored, row)))

    def copy(self, starter: str, kind: str, id_: str, to_kind: str) -> None:
        """Store a row once more, as the only one of another kind."""
        work = partial(_copy, starter=starter, kind=kind, id_=id_, to_kind=to_kind)
        self._store.submit(work, key=("copy", starter, id_, to_kind), within_s=BEHIND_S)

    async def rows(self, starter: str, kinds: Sequence[str]) -> list[HistoryRow]:
        """Return what is stored of a starter, with what was put before this; the oldest first; StoreError."""
        work = partial(_rows, starter=starter, kinds=kinds)
        return await asyncio.wrap_future(self._store.submit(work, is_flushed=False))

    async def close(self, *, within_s: float) -> bool:
        """Close the file when all is written; return whether there was time for it."""
        return await asyncio.to_thread(self._store.close, within_s=within_s) and not self._store.unsaved

    def _note_stored(self, row: HistoryRow, future: Future[None]) -> None:
        if future.exception() is None:
            self._on_stored(row)


def read_history(state_dir: Path, starter: str) -> list[HistoryRow]:
    """Return what is stored of a starter, the oldest first, beside a gateway that runs or not; StoreError."""
    return read_file(state_dir / HISTORY_FILE, HISTORY, partial(_rows, starter=starter, kinds=()))


def with_curves(rows: Sequence[HistoryRow]) -> list[HistoryRow]:
    """Return the rows, each start with its `samples`, where these are stored: they are rows of `CURVES`."""
    curves = {row.id: row.data for row in rows if row.kind in CURVES}
    return [
        row._replace(data={**row.data, "samples": curves[row.id]})
        if row.kind == "start" and row.id in curves
        else row
        for row in rows
    ]


def _write(connection: Connection, *, row: HistoryRow) -> None:
    """Store a row, and delete those of its kind that are too many now."""
    packed = zlib.compress(json.dumps(row.data, separators=(",", ":")).encode(), wbits=_WINDOW_BITS)
    connection.execute(_PUT, (row.starter, row.kind, row.id, time.time(), packed))
    connection.execute(_PRUNE, (row.starter, row.kind, row.starter, row.kind, row.limit))


def _copy(connection: Connection, *, starter: str, kind: str, id_: str, to_kind: str) -> None:
    if connection.execute(_COPY, (to_kind, starter, kind, id_)).rowcount > 0:
        connection.execute(_PRUNE, (starter, to_kind, starter, to_kind, 1))


def _rows(connection: Connection, *, starter: str, kinds: Sequence[str]) -> list[HistoryRow]:
    """Return the rows of these kinds (none: of all) that can be read."""
    of_kinds = f" AND kind IN ({', '.join('?' * len(kinds))})" if kinds else ""
    found = connection.execute(f"{_OF_STARTER}{of_kinds} ORDER BY number", (starter, *kinds))
    rows = []
    for kind, id_, packed in found:
        with suppress(zlib.error, ValueError):
            rows.append(HistoryRow(starter, kind, id_, json.loads(zlib.decompress(packed))))
    return rows
