"""The thread that writes a database: intents and finals first, everything else in batches.

1. The caller never waits for the disk. A piece's future completes when its transaction is on the disk.
2. Urgent pieces are done first, by themselves: intents, then finals. The others follow in batches; a batch
   ends after 500 pieces, after 50 ms, or when an urgent one comes.
3. A piece with a key is lasting: it waits until it is done, whatever the disk does, and newer work of its key
   gets its place and its future. Of each table only so many wait, and the oldest go. All others fail
   when the disk does.
4. A bad file never stops the gateway: it is tried again, a damaged one is set aside. On a full disk only what
   deletes is done, by means of a reserve.

WAL with synchronous FULL survives a power cut, if the disk flushes when asked to (sqlite.org/pragma.html,
synchronous).
"""

from __future__ import annotations

import asyncio
import enum
import logging
import queue
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future
from functools import partial
from itertools import count
from math import inf
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from gateway.errors import StoreError
from gateway.store.database import Connection, Database, FullError, Schema, Work
from gateway.system.supervised import is_set_within, on_this_loop

log = logging.getLogger(__name__)

Key = tuple[str, ...]  # names what the work is about, the table first; no table: it does not last
T = TypeVar("T")

MAX_BYTES = 256 * 2**20  # what is in a file has bounds of its own, together half as high
MOST_WAITING = 10_000  # lasting pieces of a table
MOST_AT_ONCE = 500  # pieces in one transaction
RETRY_S = 5.0  # between attempts on a file that cannot be written
HANG_S = 2.0  # a disk that is at one transaction for so long counts as away
BEHIND_S = 0.5  # how long what is written behind waits for another transaction
BATCH_S = 0.05  # of one transaction, while there is more to do


class News(enum.StrEnum):
    """A change of a store's state."""

    OPEN = "store_open"  # for the first time
    BACK = "store_back"  # open again, after AWAY
    AWAY = "store_away"  # nothing can be stored
    LOST = "store_lost"  # the file was set aside; a new one is in use


OnNews = Callable[[News, str], None]  # with a text for people


class Piece(NamedTuple):
    """Some work that waits, and its answer."""

    key: Key
    urgency: int  # which goes first: an intent (2), then a final (1), then all others (0)
    work: Work
    is_flushed: bool
    is_freeing: bool
    future: Future[Any]

    @property
    def is_lasting(self) -> bool:
        """Return whether it waits until it is done, whatever the disk does."""
        return bool(self.key[0])

    def begin(self) -> bool:
        """Return whether it is to be done: its caller has not given it up meanwhile."""
        return self.future.running() or self.future.set_running_or_notify_cancel()


class Store:
    """The file and its thread; `path` None: the same in memory.

    `prepare` is called in the thread before the file is opened; a StoreError of it says that that is away.
    """

    def __init__(
        self,
        path: Path | None,
        schema: Schema,
        *,
        most_waiting: int = MOST_WAITING,
        prepare: Callable[[], object] = lambda: None,
    ) -> None:
        self._prepare = prepare
        self._file = Database(path, schema, max_bytes=MAX_BYTES)
        self._on_news: OnNews = lambda *_: None
        self._waiting: dict[Key, Piece] = {}  # until they are done
        self._most_waiting = most_waiting
        self._counts: Counter[str] = Counter()  # of what waits, by table
        self._numbers = count()  # of work that does not last
        self._urged = 0  # how often something urgent has come
        self._lock = threading.Lock()  # of what waits
        self._wake: queue.SimpleQueue[float | None] = queue.SimpleQueue()  # by when; None: the end
        self._thread = threading.Thread(target=self._run, name=schema.name, daemon=True)
        self._error: StoreError | None = StoreError("it is not open yet")  # why nothing can be stored
        self._retry_s = 0.0  # when what failed is tried again; 0: nothing has been tried yet
        self._busy_since_s = inf  # at one transaction
        self._is_closed = False

    @property
    def trouble(self) -> str:
        """Return why nothing can be stored now; empty when it can."""
        if self._error is not None:
            return str(self._error)
        busy_s = self._busy_s()
        return f"the disk has not answered for {busy_s:.0f} s" if busy_s > HANG_S else ""

    @property
    def is_unreadable(self) -> bool:
        """Return whether not even reading is possible; on a full disk it is. False before the first try."""
        return self._busy_s() > HANG_S or (self.is_away and not self._file.is_open)

    @property
    def is_away(self) -> bool:
        """Return whether the last attempt to store something has failed."""
        return self._error is not None and self._retry_s > 0.0

    @property
    def unsaved(self) -> int:
        """Return how many lasting pieces wait for the disk."""
        return self._counts.total() - self._counts[""]

    def start(self, on_news: OnNews) -> None:
        """Begin; the file is opened in the thread, which calls `on_news`."""
        self._on_news = on_news
        self._file.on_lost = partial(on_news, News.LOST)
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

        Urgent work is done first; the rest may wait (`within_s`) for a transaction that something else
        begins. Work that need not be flushed at once outlives the process, but perhaps not a power cut.
        Freeing work only deletes, and is done on a full disk too: it should touch less than a quarter of the
        reserve.
        """
        urgency, oldest = is_urgent + (is_urgent and key is None), None
        key = key or ("", str(next(self._numbers)))
        if self._is_closed:
            return _ended(Future(), "the store is closed")
        with self._lock:
            older = self._waiting.get(key)
            future: Future[T] = Future() if older is None else older.future
            urgency = urgency if older is None else max(urgency, older.urgency)
            self._urged += urgency > 0
            piece = Piece(key, urgency, work, is_flushed, is_freeing, future)
            self._waiting[key] = piece
            self._counts[key[0]] += older is None
            if piece.is_lasting and self._counts[key[0]] > self._most_waiting:
                oldest = next((each for each in self._waiting.values() if _may_go(each, key)), None)
            if oldest is not None:
                self._remove(oldest)
        self._wake.put(time.monotonic() + within_s)
        if oldest is not None and oldest.begin():
            _ended(oldest.future, "too much is waiting for the disk")
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
        return time.monotonic() - self._busy_since_s

    # Everything below happens in the thread.

    def _run(self) -> None:
        is_over = False
        while not is_over:
            is_over = self._wait()
            if self._error is not None:
                self._do([])  # opens the file
            while (batch := self._take()) is not None:
                self._do(batch)
        self._file.close()

    def _wait(self) -> bool:
        """Return when something may wait no longer, and whether it is the last."""
        due_s = inf if self._error is None else self._retry_s
        while (rest_s := due_s - time.monotonic()) > 0:
            try:
                by_s = self._wake.get(timeout=None if rest_s == inf else rest_s)
            except queue.Empty:
                break
            if by_s is None:
                return True
            due_s = min(due_s, by_s)
        return False

    def _take(self) -> list[Piece] | None:
        """Return the next pieces, None when there are none; while the file is away no lasting ones.

        They wait until they are done, or have failed.
        """
        with self._lock:
            if self._error is not None and not self._counts[""]:
                return None  # all that waits is for a disk that is away
            pieces = self._waiting.values()
            ready = [piece for piece in pieces if self._error is None or not piece.is_lasting]
            first = max((piece.urgency for piece in ready), default=0)
            found = [piece for piece in ready if piece.urgency == first][:MOST_AT_ONCE]
            batch = [piece for piece in found if piece.begin()]
            for piece in found:
                if not piece.future.running():  # its caller has given it up
                    self._remove(piece)
        return batch if found else None

    def _do(self, batch: Sequence[Piece]) -> None:
        """Do what there is time for in one transaction; a piece with a bug is left out of the next one."""
        self._busy_since_s = time.monotonic()
        begun: list[Piece] = []
        try:
            answers = self._transact(batch, begun)
            for piece, answer in zip(begun, answers, strict=True):
                self._end(piece, answer)
        except StoreError as error:
            if not isinstance(error, FullError):
                self._file.close()
            self._fail(batch, error)
        except Exception as error:  # the guard at the thread's top
            log.exception("store=%s a piece of work failed", self._file.path)
            failure = StoreError(f"an error inside the gateway: {error!r}")
            if begun:
                self._end(begun[-1], error=failure)
            else:  # it is not a piece's, and comes again
                self._fail(batch, failure)
        self._busy_since_s = inf

    def _transact(self, batch: Sequence[Piece], begun: list[Piece]) -> list[Any]:
        """Do the work; on a full disk only what deletes. StoreError."""
        try:
            self._open()
            is_flushed = any(piece.is_flushed for piece in batch)
            return self._file.transact(self._in_time(batch, begun), is_flushed=is_flushed)
        except FullError as error:
            freeing = [piece for piece in batch if piece.is_freeing]
            if not freeing:
                raise
            self._fail((), error)
            return self._file.relieve(self._in_time(freeing, begun))

    def _open(self) -> None:
        """See to it that the file is open, and has room; StoreError when it is not now."""
        if self._error is None:
            return
        if time.monotonic() < self._retry_s:
            raise self._error.with_traceback(None)
        if not self._file.is_open:
            self._prepare()
            self._file.open()
        self._file.take_reserve()
        news = News.BACK if self.is_away else News.OPEN
        self._error = None
        self._on_news(news, f"{self._file.path} is open")

    def _in_time(self, batch: Sequence[Piece], begun: list[Piece]) -> Iterator[Work]:
        """Yield the pieces' work until it has taken too long, or something urgent has come meanwhile."""
        until_s = time.monotonic() + BATCH_S
        urged = self._urged
        begun.clear()
        for piece in batch:
            if begun and (time.monotonic() > until_s or self._urged > urged):
                return
            begun.append(piece)
            yield piece.work

    def _end(self, piece: Piece, answer: Any = None, error: StoreError | None = None) -> None:
        """Note that work is on the disk, or never will be; newer work of its key may have come meanwhile."""
        with self._lock:
            is_last = self._remove(piece)
        if is_last and error is None:
            piece.future.set_result(answer)
        elif is_last:
            piece.future.set_exception(error)

    def _remove(self, piece: Piece) -> bool:
        """Let a piece wait no longer; return whether it did."""
        is_waiting = self._waiting.get(piece.key) is piece
        if is_waiting:
            del self._waiting[piece.key]
            self._counts[piece.key[0]] -= 1
        return is_waiting

    def _fail(self, pieces: Iterable[Piece], error: StoreError) -> None:
        """Begin a pause before the next attempt; pieces that are not lasting have failed."""
        if time.monotonic() >= self._retry_s:  # else it is the pause that makes this error
            is_news = not self.is_away
            self._retry_s = time.monotonic() + RETRY_S
            self._error = error
            if is_news:
                self._on_news(News.AWAY, str(error))
        for piece in pieces:
            if not piece.is_lasting:
                self._end(piece, error=error)


def _may_go(piece: Piece, newest: Key) -> bool:
    """Return whether a piece is given up for the newest of its table: none that is being done."""
    return piece.key[0] == newest[0] and piece.key != newest and not piece.future.running()


def _ended(future: Future[T], trouble: str) -> Future[T]:
    future.set_exception(StoreError(trouble))
    return future
