"""Work that is written behind: the newest of each key waits in memory until the disk has done it.

While the file is away it waits on, for a bounded number of keys. A part at a time is written, with another
transaction if there is one soon; each success starts the next part, and after a failure one starts when the
file is back (`resume`), or some seconds later. Work with a bug is given up alone.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Hashable, Sequence
from concurrent.futures import Future
from functools import partial
from itertools import islice
from typing import Any

from gateway.errors import UnstorableError
from gateway.store.database import Connection, Work
from gateway.store.worker import BEHIND_S, RETRY_S, Store
from gateway.system.supervised import is_set_within, on_this_loop

MOST_KEYS = 10_000  # the oldest are given up
AT_ONCE = 100  # in one transaction

Done = Sequence[tuple[Hashable, Work]]


class Behind:
    """All calls on the app's loop; `on_lost` is called for each key that is given up."""

    def __init__(self, store: Store, *, on_lost: Callable[[], None] = lambda: None) -> None:
        self._store = store
        self._on_lost = on_lost
        self._waiting: dict[Hashable, Work] = {}  # the oldest first
        self._is_writing = False
        self._at_once = AT_ONCE
        self._is_idle = asyncio.Event()
        self._retry: asyncio.TimerHandle | None = None

    def __len__(self) -> int:
        return len(self._waiting)

    def __contains__(self, key: Hashable) -> bool:
        return key in self._waiting

    def put(self, key: Hashable, work: Work) -> None:
        """Do some work soon, in the place of what waits under its key."""
        self._set(key, work)
        self.resume()

    def put_now(self, key: Hashable, work: Work) -> Future[Done]:
        """Do some work at once; the future fails when that cannot be, and the work is tried again."""
        self._set(key, work)
        return self.hurry(key)

    def hurry(self, key: Hashable) -> Future[Done]:
        """Do at once what waits under a key."""
        return self._submit((key,), within_s=0.0)

    async def finish(self, *, within_s: float) -> None:
        """Do all that waits, before an orderly end; return when that is done, or cannot be in time."""
        self._at_once = MOST_KEYS
        if self._waiting and not self._store.trouble:
            self.resume()
            self._store.submit(lambda _: None, is_urgent=True)  # the part rides with this
            await is_set_within(self._is_idle, within_s)

    def resume(self) -> None:
        """Have the next part done of what waits."""
        if self._waiting and not self._is_writing:
            self._is_writing = True
            self._is_idle.clear()
            self._submit((), within_s=BEHIND_S if len(self._waiting) < AT_ONCE else 0.0)

    def _set(self, key: Hashable, work: Work) -> None:
        self._waiting.pop(key, None)
        self._waiting[key] = work
        if len(self._waiting) > MOST_KEYS:
            self._give_up(next(iter(self._waiting)))

    def _give_up(self, key: Hashable) -> None:
        if self._waiting.pop(key, None) is not None:
            self._on_lost()

    def _submit(self, keys: Sequence[Hashable], *, within_s: float) -> Future[Done]:
        """Have a piece of work done: what waits under these keys, or under the oldest ones for none."""
        begun: list[Hashable] = []
        work = partial(self._write, keys, begun)
        future = self._store.submit(work, is_urgent=bool(keys), within_s=within_s)
        future.add_done_callback(on_this_loop(partial(self._note, begun, is_part=not keys)))
        return future

    def _write(self, keys: Sequence[Hashable], begun: list[Hashable], connection: Connection) -> Done:
        """Do the newest that waits by now, in the store's thread, and return it; `begun` gets its keys."""
        begun.clear()
        some = [(key, self._waiting.get(key)) for key in keys or list(islice(self._waiting, self._at_once))]
        done = [(key, work) for key, work in some if work is not None]
        for key, work in done:
            begun.append(key)
            work(connection)
        return done

    def _note(self, begun: Sequence[Hashable], future: Future[Done], *, is_part: bool) -> None:
        if is_part:
            self._is_writing = False
        error = future.exception()
        if error is None:
            for key, work in future.result():
                if self._waiting.get(key) is work:  # else there is a newer one
                    del self._waiting[key]
        elif isinstance(error, UnstorableError) and begun:
            self._give_up(begun[-1])
        else:
            loop = asyncio.get_running_loop()
            if self._retry is None or self._retry.when() <= loop.time():
                self._retry = loop.call_later(RETRY_S, self.resume)
            self._is_idle.set()
            return
        if not self._waiting:
            self._is_idle.set()
        self.resume()


async def is_done_within(future: Future[Any], within_s: float) -> bool:
    """Return whether work is done in time; if it is not, it is not given up."""
    done = asyncio.Event()
    future.add_done_callback(on_this_loop(lambda _: done.set()))
    await is_set_within(done, within_s)
    return future.done() and future.exception() is None
