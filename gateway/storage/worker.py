"""The thread that writes a database.

The caller never waits for the disk. Pieces of work are done in order, many in one transaction, and a piece's
future completes when its transaction is on the disk. WAL with synchronous FULL survives a power cut, if the
disk flushes when asked to (sqlite.org/pragma.html, synchronous). A bad file never stops the gateway: a
damaged or foreign one is set aside, and a failed write is tried again.
"""

from __future__ import annotations

import enum
import logging
import queue
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from gateway.errors import DamagedError, StoreError, UnstorableError
from gateway.storage.database import CACHE_KIB, Connection, Database, FullError, SqlTable

log = logging.getLogger(__name__)

T = TypeVar("T")

MAX_BYTES = 64 * 2**20
RETRY_S = 5.0  # between attempts on a file that cannot be written
HANG_S = 2.0  # a disk that is at one transaction for so long counts as away
MOST_WAITING = 10_000
MOST_AT_ONCE = 500  # pieces in one transaction
MOST_ROOM_MADE = 4  # times, a tenth each, for one transaction


class News(enum.StrEnum):
    """A change of a store's state."""

    OPEN = "store_open"  # for the first time, or again after AWAY
    AWAY = "store_away"  # nothing can be stored
    LOST = "store_lost"  # the file was set aside or is gone; a new one is in use


OnNews = Callable[[News, str], None]  # with a text for people


class Store:
    """The file and its thread."""

    def __init__(
        self,
        path: Path,
        tables: Sequence[SqlTable],
        *,
        max_bytes: int = MAX_BYTES,
        retry_s: float = RETRY_S,
        name: str = "store",
        cache_kib: int = CACHE_KIB,
    ) -> None:
        self._file = Database(path, tables, max_bytes, cache_kib=cache_kib)
        self._on_news: OnNews = lambda *_: None
        self._queue: queue.SimpleQueue[_Piece | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._trouble = "it is not open yet"
        self._reported: News | None = None
        self._pause_s = retry_s
        self._retry_s = 0.0  # when a file that could not be opened is tried again
        self._busy_since_s: float | None = None
        self._is_closed = False

    @property
    def trouble(self) -> str:
        """Return why nothing can be stored now; empty when it can."""
        since_s = self._busy_since_s
        busy_s = 0.0 if since_s is None else time.monotonic() - since_s
        if not self._trouble and busy_s > HANG_S:
            return f"the disk has not answered for {busy_s:.0f} s"
        return self._trouble

    @property
    def lost_s(self) -> float | None:
        """Return when (UTC) the file before the present one was lost; None when there was none."""
        return self._file.lost_s

    def start(self, on_news: OnNews) -> None:
        """Begin; the file is opened in the thread, which calls `on_news`."""
        self._on_news = on_news
        self._thread.start()

    def submit(self, work: Callable[[Connection], T], *, is_flushed: bool = True) -> Future[T]:
        """Do some work in a transaction; the future is done when it is on the disk, or has a StoreError.

        What need not be flushed at once outlives the process, but perhaps not a power cut.
        """
        piece = _Piece(work, is_flushed)
        if self._is_closed or self._queue.qsize() >= MOST_WAITING:
            why = "the store is closed" if self._is_closed else "too much is waiting for the disk"
            piece.future.set_exception(StoreError(why))
        else:
            self._queue.put(piece)
        return piece.future

    def close(self, *, within_s: float) -> bool:
        """Do what has been submitted, then close the file; return whether there was time for it."""
        self._is_closed = True
        self._queue.put(None)
        if self._thread.ident is not None:
            self._thread.join(within_s)
        return not self._thread.is_alive()

    # Everything below happens in the thread.

    def _run(self) -> None:
        batch: list[_Piece] = []
        is_over = False
        while not is_over:
            self._busy_since_s = time.monotonic()
            self._serve(batch)
            self._busy_since_s = None
            batch, is_over = self._next_batch()
        self._serve(batch)
        self._file.close()

    def _next_batch(self) -> tuple[list[_Piece], bool]:
        """Return what waits, nothing when it is time to try the file again, and whether this is the last."""
        batch: list[_Piece] = []
        try:
            item = self._queue.get(timeout=self._pause_s if self._trouble else None)
            while item is not None:
                if item.future.set_running_or_notify_cancel():
                    batch.append(item)
                if len(batch) == MOST_AT_ONCE:
                    return batch, False
                item = self._queue.get_nowait()
        except queue.Empty:
            return batch, False
        return batch, True

    def _serve(self, batch: Sequence[_Piece]) -> None:
        """Do all pieces in one transaction; one by one when a bug of one of them is in the way."""
        try:
            self._open()
            answers = self._attempt(batch)
        except StoreError as error:
            self._go_away(str(error))
            for piece in batch:
                piece.future.set_exception(error)
        except Exception as error:  # the guard at the thread's top
            if len(batch) > 1:
                for piece in batch:
                    self._serve([piece])
                return
            log.exception("store=%s a piece of work failed", self._file.path)
            for piece in batch:
                piece.future.set_exception(UnstorableError(f"an error inside the gateway: {error!r}"))
        else:
            for piece, answer in zip(batch, answers, strict=True):
                piece.future.set_result(answer)

    def _open(self) -> None:
        """See to it that the file is open and where it belongs; StoreError when that is not possible now."""
        if self._file.is_open and not self._file.is_in_place:
            self._file.close()
            self._file.open(is_lost=True)
            self._report(News.LOST, f"{self._file.path} was removed while in use; a new one is used")
        if self._file.is_open:
            return
        if time.monotonic() < self._retry_s:
            raise StoreError(self._trouble)
        lost = self._file.open()
        if lost:
            self._report(News.LOST, lost)
        self._trouble = ""
        self._report(News.OPEN, f"{self._file.path} is open")

    def _attempt(self, batch: Sequence[_Piece]) -> list[Any]:
        """Do the work; once more after room was made, which may take a few times, or another file taken."""
        works = [piece.work for piece in batch]
        is_flushed = any(piece.is_flushed for piece in batch)
        for _ in range(MOST_ROOM_MADE):
            try:
                return self._file.transact(works, is_flushed=is_flushed)
            except FullError:
                self._file.make_room()
            except DamagedError as error:
                self._report(News.LOST, self._file.replace(error))
        return self._file.transact(works, is_flushed=is_flushed)

    def _go_away(self, trouble: str) -> None:
        self._file.close()
        if not self._trouble or time.monotonic() >= self._retry_s:
            self._retry_s = time.monotonic() + self._pause_s
        self._trouble = trouble
        if self._reported is not News.AWAY:
            self._report(News.AWAY, trouble)

    def _report(self, news: News, text: str) -> None:
        self._reported = news
        self._on_news(news, text)


@dataclass(frozen=True, slots=True)
class _Piece:
    work: Callable[[Connection], Any]
    is_flushed: bool
    future: Future[Any] = field(default_factory=Future)
