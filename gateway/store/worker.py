"""The thread that writes a database: intents and finals first, everything else in batches.

The caller never waits for the disk. A piece's future completes when its transaction is on the disk. Urgent
pieces are done first. All others follow in batches; a batch ends after 500 pieces, after 50 ms, or when an
urgent one comes.

WAL with synchronous FULL survives a power cut, if the disk flushes when asked to (sqlite.org/pragma.html,
synchronous). A bad file never stops the gateway: a damaged or foreign one is set aside, a failed write is
reported to its caller, and the file is tried again. Work with a key waits for that. On a full disk only what
deletes is done, by means of a reserve.
"""

from __future__ import annotations

import asyncio
import enum
import logging
import queue
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from functools import partial
from math import inf
from pathlib import Path
from typing import Any, TypeVar

from gateway.errors import DamagedError, StoreError, UnstorableError
from gateway.store.database import Connection, Database, FullError, Schema, Work
from gateway.store.waiting import MOST_WAITING, Key, Piece, Waiting
from gateway.system.supervised import is_set_within, on_this_loop

log = logging.getLogger(__name__)

T = TypeVar("T")

MAX_BYTES = 256 * 2**20  # what is in a file has bounds of its own, together half as high
RETRY_S = 5.0  # between attempts on a file that cannot be written
HANG_S = 2.0  # a disk that is at one transaction for so long counts as away
BEHIND_S = 0.5  # how long what is written behind waits for another transaction
BATCH_S = 0.05  # of one transaction, while there is more to do


class News(enum.StrEnum):
    """A change of a store's state."""

    OPEN = "store_open"  # for the first time, or again after AWAY or LOST
    AWAY = "store_away"  # nothing can be stored
    LOST = "store_lost"  # the file was set aside or is gone; a new one is in use


OnNews = Callable[[News, str], None]  # with a text for people


class Store:
    """The file and its thread; `path` None: the same in memory.

    `prepare` is called in the thread until the file was open once; a StoreError of it says that
    the file is away.
    """

    def __init__(
        self,
        path: Path | None,
        schema: Schema,
        *,
        max_bytes: int = MAX_BYTES,
        retry_s: float = RETRY_S,
        most_keys: int = MOST_WAITING,
        prepare: Callable[[], object] = lambda: None,
    ) -> None:
        self._prepare: Callable[[], object] | None = prepare
        self._file = Database(path, schema, max_bytes=max_bytes)
        self._file.on_lost = partial(self._report, News.LOST)
        self._on_news: OnNews = lambda *_: None
        self._waiting = Waiting(most_keys)
        self._wake: queue.SimpleQueue[float | None] = queue.SimpleQueue()  # by when; None: the end
        self._thread = threading.Thread(target=self._run, name=schema.name, daemon=True)
        self._trouble = "it is not open yet"
        self._reported: News | None = None
        self._pause_s = retry_s
        self._retry_s = 0.0  # when what failed is tried again
        self._busy_since_s: float | None = None
        self._is_closed = False

    @property
    def trouble(self) -> str:
        """Return why nothing can be stored now; empty when it can."""
        busy_s = self._busy_s()
        if not self._trouble and busy_s > HANG_S:
            return f"the disk has not answered for {busy_s:.0f} s"
        return self._trouble

    @property
    def is_unreadable(self) -> bool:
        """Return whether not even reading is possible; on a full disk it is. False before the first try."""
        return self._busy_s() > HANG_S or (self.is_away and not self._file.is_open)

    @property
    def is_away(self) -> bool:
        """Return whether the last attempt to store something has failed."""
        return self._reported is News.AWAY

    @property
    def unsaved(self) -> int:
        """Return how many pieces with a key wait for the disk."""
        return self._waiting.keyed

    def start(self, on_news: OnNews) -> None:
        """Begin; the file is opened in the thread, which calls `on_news`."""
        self._on_news = on_news
        self._thread.start()

    def submit(
        self,
        work: Callable[[Connection], T],
        *,
        key: Key | None = None,
        is_urgent: bool = False,
        is_flushed: bool = True,
        is_freeing: bool = False,
        within_s: float = 0.0,
    ) -> Future[T]:
        """Do some work in a transaction; the future is done when it is on the disk, or has a StoreError.

        Urgent work is done first, then work with a key, then the others; each keeps its order among its like,
        and may wait (`within_s`) for a transaction that something else begins. With a key it waits for a
        disk that is away, and newer work of that key takes its place: the future is done when the newest is
        on the disk, or is given up. Work that need not be flushed at once outlives the process, but perhaps
        not a power cut. Freeing work only deletes, and is done on a full disk too: it should touch less than
        a quarter of the reserve.
        """
        piece = Piece(work, key, is_urgent, is_flushed, is_freeing)
        if self._is_closed:
            piece.future.set_exception(StoreError("the store is closed"))
            return piece.future
        future = self._waiting.put(piece)
        self._wake.put(time.monotonic() + within_s)
        return future

    async def has_done(self, future: Future[Any], within_s: float) -> bool:
        """Return whether work is done in time, for which a file that is away leaves none.

        Work that is not done is not given up. On the app's loop.
        """
        done = asyncio.Event()
        future.add_done_callback(on_this_loop(lambda _: done.set()))
        await is_set_within(done, 0.0 if self.is_away else within_s)
        return future.done() and future.exception() is None

    def close(self, *, within_s: float) -> bool:
        """Do what has been submitted, then close the file; return whether there was time for it."""
        self._is_closed = True
        self._wake.put(None)
        if self._thread.ident is not None:
            self._thread.join(within_s)
        return not self._thread.is_alive()

    def _busy_s(self) -> float:
        since_s = self._busy_since_s
        return 0.0 if since_s is None else time.monotonic() - since_s

    # Everything below happens in the thread.

    def _run(self) -> None:
        is_over = False
        while not is_over:
            is_over = self._wait()
            self._do([])  # opens the file
            while (batch := self._waiting.take(is_away=bool(self._trouble))) is not None:
                self._do(batch)  # empty when the callers have given all of it up
        self._file.close()

    def _wait(self) -> bool:
        """Return when something may wait no longer, and whether it is the last."""
        due_s = self._retry_s if self._trouble else inf
        while (rest_s := due_s - time.monotonic()) > 0:
            try:
                by_s = self._wake.get(timeout=None if rest_s == inf else rest_s)
            except queue.Empty:
                break
            if by_s is None:
                return True
            due_s = min(due_s, by_s)
        return False

    def _do(self, batch: Sequence[Piece]) -> None:
        """Do what there is time for in one transaction; a piece with a bug is left out of the next one."""
        self._busy_since_s = time.monotonic()
        begun: list[tuple[Piece, Work]] = []
        try:
            self._open()
            self._finish(begun, self._attempt(batch, begun))
            self._waiting.put_back(batch)
        except FullError as error:
            self._go_away(error)
            self._relieve(batch, error)
        except StoreError as error:
            self._file.close()
            self._go_away(error)
            self._waiting.fail(batch, error)
        except Exception as error:  # the guard at the thread's top
            log.exception("store=%s a piece of work failed", self._file.path)
            failure = _unstorable(error)
            if begun:
                self._waiting.end(*begun[-1], error=failure)
                self._waiting.put_back(batch)
            else:  # it is not a piece's, and comes again
                self._go_away(failure)
                self._waiting.fail(batch, failure)
        self._busy_since_s = None

    def _open(self) -> None:
        """See to it that the file is open, and has room; StoreError when it is not now."""
        if self._file.is_open and not self._trouble:
            return
        if time.monotonic() < self._retry_s:
            raise FullError(self._trouble) if self._file.is_open else StoreError(self._trouble)
        if not self._file.is_open:
            if self._prepare is not None:
                self._prepare()
            self._file.open()
            self._prepare = None
        self._file.take_reserve()
        self._trouble = ""
        self._report(News.OPEN, f"{self._file.path} is open")

    def _attempt(self, batch: Sequence[Piece], begun: list[tuple[Piece, Work]]) -> list[Any]:
        """Do the work; once more in a new file where the one in use is damaged."""
        if not batch:
            return []
        is_flushed = any(piece.is_flushed for piece in batch)
        try:
            return self._file.transact(self._in_time(batch, begun), is_flushed=is_flushed)
        except DamagedError as error:
            self._file.replace(error)
        return self._file.transact(self._in_time(batch, begun), is_flushed=is_flushed)

    def _in_time(self, batch: Sequence[Piece], begun: list[tuple[Piece, Work]]) -> Iterator[Work]:
        """Yield the pieces' work until it has taken too long, or something urgent has come meanwhile."""
        until_s = time.monotonic() + BATCH_S
        had_urgent = self._waiting.urgent
        begun.clear()
        for piece in batch:
            if begun and (time.monotonic() > until_s or self._waiting.urgent > had_urgent):
                return
            work = piece.work
            begun.append((piece, work))
            yield work

    def _finish(self, begun: Sequence[tuple[Piece, Work]], answers: Sequence[Any]) -> None:
        for (piece, work), answer in zip(begun, answers, strict=True):
            self._waiting.end(piece, work, answer)

    def _relieve(self, batch: Sequence[Piece], error: FullError) -> None:
        """Do what deletes although the disk is full; all else fails, or waits."""
        freeing = [(piece, piece.work) for piece in batch if piece.is_freeing]
        self._waiting.fail([piece for piece in batch if not piece.is_freeing], error)
        if freeing:
            try:
                self._finish(freeing, self._file.relieve([work for _, work in freeing]))
            except Exception as failure:
                if not isinstance(failure, StoreError):
                    log.exception("store=%s a piece of work failed on a full disk", self._file.path)
                self._waiting.fail((piece for piece, _ in freeing), _unstorable(failure))

    def _go_away(self, error: StoreError) -> None:
        """Begin a pause before the next attempt, unless this error is one that the pause makes."""
        if time.monotonic() < self._retry_s:
            return
        self._retry_s = time.monotonic() + self._pause_s
        self._trouble = str(error)
        if self._reported is not News.AWAY:
            self._report(News.AWAY, self._trouble)

    def _report(self, news: News, text: str) -> None:
        self._reported = news
        self._on_news(news, text)


def _unstorable(error: Exception) -> StoreError:
    """Return what the caller gets of a failure, which may be a bug."""
    return (
        error if isinstance(error, StoreError) else UnstorableError(f"an error inside the gateway: {error!r}")
    )
