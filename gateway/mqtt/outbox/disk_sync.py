"""Keeps the outbox's file up to date, paces the history, and declares losses.

Sending never waits for the disk: a message goes out whether it is on the disk or not, and one that was
acknowledged before it was written is never written.

1. Every BATCH_S, what is new or acknowledged is written in one transaction (`DiskSync.run`). Events, results
   and losses are flushed to the disk, values at the latest after FLUSH_S.
2. While the broker is connected, rows of earlier times are read back page by page, and values that were
   replaced before they were sent are published as history, at most 200 every PACE_S (`DiskSync.pace`).
3. What memory or disk could not hold is declared once, in the event `gap`.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from typing import assert_never

from gateway.contract import EventCode, PublishEvent
from gateway.errors import StoreError
from gateway.mqtt.outbox.losses import Losses
from gateway.mqtt.outbox.outbox import Outbox
from gateway.storage.outbox import OutboxDisk
from gateway.storage.spool import Changes, Kind, Recalled
from gateway.storage.worker import News
from gateway.system.clock import Clock

log = logging.getLogger(__name__)

BATCH_S = 0.2  # what is put within this time goes to the disk at once
FLUSH_S = 5.0  # values may be in the kernel's hands for so long
RETRY_S = 1.0
RECALL_WITHIN_S = 5.0  # after this time the start continues without what earlier runs left
PAGE_ROWS = 400
PACE_S = 0.2  # a history of at most 200 values each time: 1000 values a second
REFUSED_EVERY_S = 3600.0


class DiskSync:
    """Links one outbox and its disk; `publish_event` publishes an event, `wake` has the outbox sent.

    The caller runs the two endless loops, `run` and `pace`, between `start` and `close`.
    """

    def __init__(
        self,
        outbox: Outbox,
        disk: OutboxDisk,
        *,
        clock: Clock,
        publish_event: PublishEvent,
        wake: Callable[[], None],
    ) -> None:
        self._outbox = outbox
        self._backlog = outbox.backlog
        self._disk = disk
        self._clock = clock
        self._publish_event = publish_event
        self._wake = wake
        self._work = asyncio.Event()
        self._history = asyncio.Event()
        self._stepping = asyncio.Lock()
        self._is_recalled = self._is_away = False
        self._waiting: list[Callable[[], None]] = []
        self._losses = Losses()
        self._flushed_s = self._refused_logged_s = float("-inf")
        self._refused = 0
        self._backlog.is_disk_away = lambda: bool(disk.trouble)
        self._backlog.on_work = self._note_work

    def start(self) -> None:
        """Begin to store what waits; a thread opens the file."""
        self._disk.start(self._on_disk_news)
        asyncio.get_running_loop().call_later(RECALL_WITHIN_S, self._wait_no_longer)

    def when_recalled(self, call: Callable[[], None]) -> None:
        """Call when it is known what earlier runs have left behind, or when that takes too long."""
        if self._is_recalled:
            call()
        else:
            self._waiting.append(call)

    async def run(self) -> None:
        """Keep the disk up to date, until cancelled."""
        self._work.set()  # also after a restart of this loop
        while True:
            await self._work.wait()
            await asyncio.sleep(BATCH_S)
            self._work.clear()
            async with self._stepping:
                is_done = await self._step()
            if not is_done:
                await asyncio.sleep(RETRY_S)
                self._work.set()

    async def pace(self) -> None:
        """Publish the history a little at a time, until cancelled."""
        self._history.set()
        while True:
            await self._history.wait()
            self._history.clear()
            while self._outbox.is_connected and self._backlog.has_history:
                self._outbox.grant_history()
                self._wake()
                await asyncio.sleep(PACE_S)
            self._outbox.grant_history(0)

    async def close(self, *, within_s: float) -> None:
        """Write what was not sent, and close the disk; nothing is sent any more."""
        self._outbox.disconnected()
        try:
            async with asyncio.timeout(within_s / 2), self._stepping:
                if not self._disk.trouble:
                    await self._write()
        except (TimeoutError, StoreError) as error:
            log.warning("outbox: what waits for the broker could not be stored: %s", error or "no time")
        if not await self._disk.close(within_s / 2):
            log.warning("outbox: the disk took too long")

    def _note_work(self) -> None:
        self._work.set()
        if self._outbox.is_connected:
            self._history.set()

    def _on_disk_news(self, news: News, text: str) -> None:
        match news:
            case News.OPEN:
                log.info("outbox %s", text)
                if self._is_away:
                    self._publish_event(EventCode.OUTBOX_AVAILABLE)
                self._is_away = False
            case News.AWAY:
                self._is_away = True
                self._publish_event(EventCode.OUTBOX_UNAVAILABLE, trouble=text)
            case News.LOST:
                self._backlog.lose_disk()
                self._losses.lose_disk()
                self._publish_event(EventCode.OUTBOX_LOST, trouble=text)
            case _:
                assert_never(news)
        self._work.set()

    def _wait_no_longer(self) -> None:
        waiting, self._waiting = self._waiting, []
        for call in waiting:
            call()

    async def _step(self) -> bool:
        self._losses.note(self._backlog.take_losses(self._clock.utc_s))
        self._declare()
        self._publish_refused()
        if self._disk.trouble:
            return False
        try:
            if not self._is_recalled:
                self._recall(await self._disk.recall())
            await self._write()
            await self._read()
        except StoreError as error:
            log.debug("outbox: %s", error)
            return False
        return True

    def _recall(self, recalled: Recalled) -> None:
        self._is_recalled = True
        shares = {
            kind: share._replace(first_s=self._steady_s(share.first_s))
            for kind, share in recalled.shares.items()
        }
        self._backlog.recall(recalled._replace(shares=shares))
        self._losses.note_saved(recalled.losses)
        self._wait_no_longer()
        self._note_work()

    async def _write(self) -> None:
        while (changes := self._changes()) is not None:
            try:
                losses = await self._disk.apply(changes)
            except BaseException:
                self._backlog.unwritten(changes)
                self._losses.unwritten(changes)
                raise
            self._backlog.written()
            for loss in losses:
                self._backlog.drop(loss)
            self._losses.note_saved(losses)
            if changes.is_flushed:
                self._flushed_s = self._clock.now_s()

    def _changes(self) -> Changes | None:
        changes = self._losses.changes(self._backlog.collect(self._clock.utc_s))
        if changes is None:
            return None
        is_old = self._clock.now_s() - self._flushed_s > FLUSH_S
        matters = bool(changes.losses) or any(row.kind is not Kind.VALUE for row in changes.rows)
        return changes._replace(is_flushed=is_old or matters)

    async def _read(self) -> None:
        """Read rows back into memory while they are being sent."""
        is_read = False
        for segment, wanted in self._backlog.wanted() if self._outbox.is_connected else ():
            try:
                page = await self._disk.page(
                    segment.kind, after=wanted.after, before=wanted.before, most=PAGE_ROWS
                )
            except BaseException:
                segment.no_page()
                raise
            rows = tuple(row._replace(time_s=self._steady_s(row.time_s)) for row in page.rows)
            self._backlog.page(segment, page._replace(rows=rows))
            self._losses.note_saved(page.losses)
            is_read = True
        if is_read:
            self._wake()
            self._note_work()

    def _steady_s(self, utc_s: float) -> float:
        """Return a wall time of the past on the steady clock; the future counts as now."""
        return self._clock.now_s() - max(0.0, self._clock.utc_s() - utc_s)

    def _declare(self) -> None:
        """Publish what was lost, once there is a connection."""
        if self._outbox.is_connected:
            now_s = self._clock.now_s()
            if declaration := self._losses.declare(now_s):
                self._publish_event(declaration)
            elif wait_s := self._losses.wait_s(now_s):
                asyncio.get_running_loop().call_later(wait_s, self._work.set)

    def _publish_refused(self) -> None:
        """Publish, once an hour at most, that the broker refuses messages; the others are counted."""
        now_s = self._clock.now_s()
        count = self._outbox.refused - self._refused
        if count and now_s - self._refused_logged_s >= REFUSED_EVERY_S:
            self._refused += count
            self._refused_logged_s = now_s
            topic, code = self._outbox.refusals[-1]
            self._publish_event(EventCode.PUBLISH_REFUSED, count=count, topic=topic, reason_code=code)
