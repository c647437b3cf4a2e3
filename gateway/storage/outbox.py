"""The outbox's file and its thread: what waits for the broker is there a moment after it was put.

A file of its own, because the ledger's commands must not wait for it. Events, results and losses are flushed
to the disk itself, values only into the kernel: a process that is killed loses none, a power cut those of the
last few seconds.
"""

from __future__ import annotations

import asyncio
from functools import partial
from pathlib import Path

from gateway.storage.outbox_table import MOST_ROWS, OutboxTable
from gateway.storage.spool import Changes, Kind, Loss, Recalled, SpoolPage
from gateway.storage.worker import MAX_BYTES, RETRY_S, OnNews, Store
from gateway.system.supervised import on_this_loop

FILE = "outbox.sqlite"


class OutboxDisk:
    """Where the outbox outlives the process: rows of this run are numbered from 1, whatever the file has."""

    def __init__(
        self,
        state_dir: Path,
        *,
        max_bytes: int = MAX_BYTES,
        most_rows: int = MOST_ROWS,
        retry_s: float = RETRY_S,
    ) -> None:
        self._table = OutboxTable(most_rows=most_rows)
        self._store = Store(
            state_dir / FILE, [self._table], max_bytes=max_bytes, retry_s=retry_s, name="outbox"
        )
        self._base = 0  # the highest number of earlier runs

    @property
    def trouble(self) -> str:
        """Return why nothing can be stored now; empty when it can."""
        return self._store.trouble

    def start(self, on_news: OnNews) -> None:
        """Begin; the file is opened in its thread, and `on_news` is called on this loop."""
        self._store.start(on_this_loop(on_news))

    async def recall(self) -> Recalled:
        """Return what earlier runs have left behind; before anything is written."""
        self._base, recalled = await asyncio.wrap_future(self._store.submit(self._table.recall))
        return recalled

    async def apply(self, changes: Changes) -> tuple[Loss, ...]:
        """Write; return what had to be dropped for it. StoreError when nothing could be written."""
        rows = tuple(row._replace(number=row.number + self._base) for row in changes.rows)
        gone = tuple((kind, number + self._base) for kind, number in changes.gone)
        work = partial(self._table.apply, changes=changes._replace(rows=rows, gone=gone))
        dropped = await asyncio.wrap_future(self._store.submit(work, is_flushed=changes.is_flushed))
        losses = (*self._table.take_made_room(), *dropped)
        return tuple(loss._replace(upto=loss.upto - self._base) for loss in losses)

    async def page(self, kind: Kind, *, after: int, before: int, most: int) -> SpoolPage:
        """Return the rows of a kind between two numbers, the oldest first."""
        after, before = after + self._base, before + self._base
        work = partial(self._table.page, kind=kind, after=after, before=before, most=most)
        page = await asyncio.wrap_future(self._store.submit(work, is_flushed=False))
        return page._replace(rows=tuple(row._replace(number=row.number - self._base) for row in page.rows))

    async def close(self, within_s: float) -> bool:
        """Close the file when all is written; return whether there was time for it."""
        return await asyncio.to_thread(self._store.close, within_s=within_s)
