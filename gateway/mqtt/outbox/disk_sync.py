"""Keeps the outbox's table up to date, and declares losses.

Sending never waits for the disk. One transaction is under way at a time; what comes meanwhile is in the next.

1. Every LOOK_S the rows that the broker has not acknowledged are written, few values at a time, so that the
   intent of a start does not wait for all of them. Rows that are acknowledged later are deleted with the next
   ones, or in another part's transaction.
2. While the broker is connected, rows that memory had no room for are read back page by page.
3. Rows that neither memory nor disk could hold are declared once, in the event `gap`.
4. When nothing can be written, rows wait in memory. On a full disk reading and deleting are still possible.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Future
from functools import partial
from typing import Any, TypeVar

from gateway.contract import EventCode, PublishEvent
from gateway.errors import StoreError
from gateway.mqtt.message import Message
from gateway.mqtt.outbox.backlog import Batch
from gateway.mqtt.outbox.outbox import Outbox
from gateway.store import BEHIND_S, Connection, News, OutboxTable, Store, Work
from gateway.system.clock import Clock
from gateway.system.rate_limits import Damped
from gateway.system.supervised import is_set_within

log = logging.getLogger(__name__)

T = TypeVar("T")

LOOK_S = 0.5  # rows wait for so long, in which the broker may acknowledge them
FLUSH_S = 5.0  # values may be in the kernel's hands for so long
RETRY_S = 1.0
COMPANY_S = 0.1  # starts of several motors share a transaction
RECALL_WITHIN_S = 5.0  # after this time the start continues without what earlier runs left
PAGE_ROWS = 400
REFUSED_EVERY_S = 3600.0  # events, also of what the history will lack


class DiskSync:
    """Links one outbox and its table in a store; `wake` has the outbox sent.

    The caller runs the endless loop, `run`, until `close`, and passes on the store's news.
    """

    def __init__(
        self,
        outbox: Outbox,
        store: Store,
        table: OutboxTable,
        *,
        clock: Clock,
        publish_event: PublishEvent,
        wake: Callable[[], None],
    ) -> None:
        self._outbox = outbox
        self._store = store
        self._table = table
        self._clock = clock
        self._publish_event = publish_event
        self._wake = wake
        self._work = asyncio.Event()
        self._stepping = asyncio.Lock()
        self._is_recalled = False
        self._flushed_s = float("-inf")
        # Called once, before any of that is sent, with the keys of what earlier runs have left, the oldest
        # first; with none when the disk takes too long. Returns those that must stay until `let_go`.
        self.on_recalled: Callable[[Sequence[str]], Iterable[str]] = lambda _: ()
        self._outbox.backlog.is_table_away = lambda: store.is_unreadable
        refused = Damped(self._publish_refused, clock=clock, every_s=REFUSED_EVERY_S)
        self._outbox.on_refused = lambda topic, code: refused.put("", (topic, code))
        self._unkept = Damped(self._publish_unkept, clock=clock, every_s=REFUSED_EVERY_S)
        self._outbox.backlog.expect_table()

    def note_news(self, news: News, _text: str) -> None:
        """Write everything again when the store has begun with a new file; read when it is open."""
        if news is News.LOST:
            self._outbox.backlog.lose_table()
        self._work.set()

    def stage(self, message: Message) -> Work:
        """Return what stores a message that has a key; once the outbox has it, that stores it by itself."""
        row = self._outbox.stage(message, self._clock.now_s())

        def store(connection: Connection) -> None:
            if self._outbox.backlog.is_to_be_stored(row):
                self._table.insert(connection, [row])

        return store

    def keep(self, message: Message) -> Future[None]:
        """Store a message that has a key; it is sent once the outbox has it, and stays until `let_go`."""
        self._need(message.key)
        return self._store.submit(self.stage(message), within_s=COMPANY_S)

    def let_go(self, key: str) -> None:
        """Let a message be deleted once the broker has it."""
        self._outbox.backlog.let_go(key)

    async def payloads(self, keys: Sequence[str]) -> dict[str, bytes]:
        """Return what was stored with these keys and is whole; StoreError."""
        return await self._do(partial(self._table.payloads, keys=keys))

    async def run(self) -> None:
        """Keep the disk up to date, until cancelled."""
        asyncio.get_running_loop().call_later(RECALL_WITHIN_S, self._wait_no_longer)
        while True:
            await is_set_within(self._work, LOOK_S)
            self._work.clear()
            async with self._stepping:
                is_done = await self._step()
            if not is_done:
                await asyncio.sleep(RETRY_S)

    async def close(self, *, within_s: float) -> None:
        """Write what was not sent; nothing is sent any more."""
        self._outbox.disconnected()
        try:
            async with asyncio.timeout(within_s), self._stepping:
                await self._write()
        except (TimeoutError, StoreError) as error:
            log.warning("outbox: what waits for the broker could not be stored: %s", error or "no time")

    def _wait_no_longer(self, keys: Sequence[str] = ()) -> None:
        call, self.on_recalled = self.on_recalled, lambda _: ()
        for key in call(keys):
            self._need(key)

    def _need(self, key: str) -> None:
        if not self._outbox.backlog.need(key):
            self._unkept.put("", None)

    async def _step(self) -> bool:
        """Do what is to be done, and return whether all of it could be."""
        now_s = self._clock.now_s()
        self._outbox.hold_slow(now_s)
        if self._outbox.is_connected and (gap := self._outbox.backlog.losses.declare(now_s)) is not None:
            self._publish_event(gap)
        try:
            if not self._is_recalled:
                await self._recall()
            await self._read()
            await self._write()
        except StoreError as error:
            log.debug("outbox: %s", error)
            self._wake()  # what is in memory does not wait for the table
            return False
        return True

    async def _recall(self) -> None:
        """Learn what earlier runs have left."""
        table = self._table
        totals, keys, losses = await self._do(lambda c: (table.totals(c), table.keys(c), table.losses(c)))
        self._is_recalled = True
        self._outbox.backlog.recall(totals, losses)
        self._wait_no_longer(keys)
        self._wake()

    async def _read(self) -> None:
        """Read rows back into memory, to be sent or given up."""
        for rank, after in self._outbox.backlog.wanted(is_sending=self._outbox.is_connected):
            page = await self._do(partial(self._table.page, rank=rank, after=after, limit=PAGE_ROWS))
            self._outbox.backlog.page(rank, page)
            self._work.set()  # another page may be wanted
            self._wake()

    async def _write(self) -> None:
        """Write all that is to be written, as far as a full disk permits."""
        backlog = self._outbox.backlog
        while (batch := backlog.batch()) is not None:
            now_s = self._clock.now_s()
            is_flushed = batch.is_flushed or now_s - self._flushed_s > FLUSH_S
            is_freeing = not batch.rows
            may_wait = is_freeing and backlog.is_empty and self._outbox.is_connected
            try:
                await self._do(
                    partial(self._written, batch),
                    is_flushed=is_flushed,
                    is_freeing=is_freeing,
                    within_s=BEHIND_S if may_wait else 0.0,
                )
            except BaseException:
                backlog.unwritten(batch)
                raise
            backlog.written(batch)
            if is_flushed:
                self._flushed_s = now_s

    def _written(self, batch: Batch, connection: Connection) -> None:
        self._table.delete(connection, ((rank, id_) for id_, rank in batch.gone.items()))
        self._table.insert(connection, batch.rows)
        if batch.losses is not None:
            self._table.set_losses(connection, batch.losses)

    async def _do(self, work: Callable[[Connection], T], *, is_freeing: bool = True, **how: Any) -> T:
        """Have work done in the store's thread; what reads or deletes is done on a full disk too."""
        how = {"is_flushed": False, **how}
        return await asyncio.wrap_future(self._store.submit(work, is_freeing=is_freeing, **how))

    def _publish_refused(self, last: tuple[str, int], count: int) -> None:
        topic, code = last
        self._publish_event(EventCode.PUBLISH_REFUSED, count=max(count, 1), topic=topic, reason_code=code)

    def _publish_unkept(self, _: None, count: int) -> None:
        self._publish_event(EventCode.HISTORY_LOST, "away", count=max(count, 1))
