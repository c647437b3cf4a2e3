"""Lets the outbox and its disk learn from each other, paces what is told late, and declares what was lost.

Nothing waits for the disk: messages go out whether it has them or not, and what was acknowledged before the
disk has heard of it never goes there.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol, assert_never

from gateway.errors import StoreError
from gateway.mqtt.outbox.losses import Losses
from gateway.mqtt.outbox.outbox import Outbox
from gateway.records import Severity
from gateway.storage.spool import Changes, Kind, Loss, Page, Recalled
from gateway.storage.worker import News
from gateway.system.clock import Clock

log = logging.getLogger(__name__)

BATCH_S = 0.2  # what is put within this time goes to the disk at once
FLUSH_S = 5.0  # values may be in the kernel's hands for so long
RETRY_S = 1.0
RECALL_WITHIN_S = 5.0  # who waits for what earlier runs left behind goes on without it
PAGE_ROWS = 400
PACE_S = 0.2  # a history of at most 200 values each time: 1000 values a second
REFUSED_EVERY_S = 3600.0

Tell = Callable[[str, Severity, str, Mapping[str, Any]], None]  # code, severity, text, data of an event


class Disk(Protocol):
    """Where rows outlive the process; all calls on the app's loop. StoreError when it cannot be done now."""

    @property
    def trouble(self) -> str:
        """Why nothing can be kept now; empty when it can."""
        ...

    def start(self, on_news: Callable[[News, str], None]) -> None:
        """Begin, and tell on this loop how it goes."""
        ...

    async def recall(self) -> Recalled:
        """Return what earlier runs have left behind."""
        ...

    async def apply(self, changes: Changes) -> Sequence[Loss]:
        """Do what the changes say, and return what had to be dropped for it."""
        ...

    async def page(self, kind: Kind, *, after: int, before: int, most: int) -> Page:
        """Return the rows of a kind between two numbers."""
        ...

    async def close(self, within_s: float) -> bool:
        """Let go; return whether all could be written."""
        ...


class DiskSync:
    """One outbox's way to its disk; `tell` publishes an event, `wake` has the outbox sent.

    Two loops, `run` and `pace`, are to be run for ever, by whoever also calls `start` and `close`.
    """

    def __init__(
        self, outbox: Outbox, disk: Disk, *, clock: Clock, tell: Tell, wake: Callable[[], None]
    ) -> None:
        self._outbox = outbox
        self._kept = outbox.kept
        self._disk = disk
        self._clock = clock
        self._tell = tell
        self._wake = wake
        self._work = asyncio.Event()
        self._history = asyncio.Event()
        self._turning = asyncio.Lock()
        self._is_recalled = self._is_away = False
        self._waiting: list[Callable[[], None]] = []
        self._losses = Losses()
        self._flushed_s = self._refused_told_s = float("-inf")
        self._refused = 0
        self._kept.is_disk_away = lambda: bool(disk.trouble)
        self._kept.on_work = self._note_work

    def start(self) -> None:
        """Begin; the disk is opened elsewhere."""
        self._disk.start(self._hear)
        asyncio.get_running_loop().call_later(RECALL_WITHIN_S, self._wait_no_longer)

    def when_recalled(self, call: Callable[[], None]) -> None:
        """Call when it is known what earlier runs have left behind, or when that takes too long."""
        if self._is_recalled:
            call()
        else:
            self._waiting.append(call)

    async def run(self) -> None:
        """Keep the disk up to date, for ever."""
        self._work.set()  # whatever was under way before, if this was started again
        while True:
            await self._work.wait()
            await asyncio.sleep(BATCH_S)
            self._work.clear()
            async with self._turning:
                is_done = await self._turn()
            if not is_done:
                await asyncio.sleep(RETRY_S)
                self._work.set()

    async def pace(self) -> None:
        """Let what was missed be told a little at a time, for ever."""
        self._history.set()
        while True:
            await self._history.wait()
            self._history.clear()
            while self._outbox.is_connected and self._kept.has_history:
                self._outbox.grant_history()
                self._wake()
                await asyncio.sleep(PACE_S)
            self._outbox.grant_history(0)

    async def close(self, *, within_s: float) -> None:
        """Write down what could not be sent, and let go of the disk; nothing is sent any more."""
        self._outbox.disconnected()
        try:
            async with asyncio.timeout(within_s / 2), self._turning:
                if not self._disk.trouble:
                    await self._write()
        except (TimeoutError, StoreError) as error:
            log.warning("outbox: what waits for the broker could not be kept: %s", error or "no time")
        if not await self._disk.close(within_s / 2):
            log.warning("outbox: the disk took too long")

    def _note_work(self) -> None:
        self._work.set()
        if self._outbox.is_connected:
            self._history.set()

    def _hear(self, news: News, text: str) -> None:
        """Hear what became of the disk's file."""
        match news:
            case News.OPEN:
                log.info("outbox %s", text)
                if self._is_away:
                    self._tell("outbox_available", Severity.INFO, "the outbox is on the disk again", {})
                self._is_away = False
            case News.AWAY:
                self._is_away = True
                self._alarm("outbox_unavailable", f"what waits for the broker is in memory only: {text}")
            case News.LOST:
                self._kept.lose_disk()
                self._losses.lose_disk()
                self._alarm("outbox_lost", f"what waited for the broker on the disk was lost: {text}")
            case _:
                assert_never(news)
        self._work.set()

    def _alarm(self, code: str, text: str) -> None:
        self._tell(code, Severity.ERROR, text, {})

    def _wait_no_longer(self) -> None:
        waiting, self._waiting = self._waiting, []
        for call in waiting:
            call()

    async def _turn(self) -> bool:
        """Do what is to be done now; return whether the disk let us."""
        self._losses.note(self._kept.take_losses(self._clock.utc_s))
        self._declare()
        self._tell_refused()
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
        self._kept.recall(recalled._replace(shares=shares))
        self._losses.note_saved(recalled.losses)
        self._wait_no_longer()
        self._note_work()

    async def _write(self) -> None:
        while (changes := self._changes()) is not None:
            try:
                losses = await self._disk.apply(changes)
            except BaseException:
                self._kept.unwritten(changes)
                self._losses.unwritten(changes)
                raise
            self._kept.written()
            for loss in losses:
                self._kept.drop(loss)
            self._losses.note_saved(losses)
            if changes.is_flushed:
                self._flushed_s = self._clock.now_s()

    def _changes(self) -> Changes | None:
        changes = self._losses.changes(self._kept.collect(self._clock.utc_s))
        if changes is None:
            return None
        is_old = self._clock.now_s() - self._flushed_s > FLUSH_S
        matters = bool(changes.losses) or any(row.kind is not Kind.VALUE for row in changes.rows)
        return changes._replace(is_flushed=is_old or matters)

    async def _read(self) -> None:
        """Fill up what is in memory, while it is being sent."""
        is_read = False
        for lane, wanted in self._kept.wanted() if self._outbox.is_connected else ():
            try:
                page = await self._disk.page(
                    lane.kind, after=wanted.after, before=wanted.before, most=PAGE_ROWS
                )
            except BaseException:
                lane.no_page()
                raise
            rows = tuple(row._replace(time_s=self._steady_s(row.time_s)) for row in page.rows)
            self._kept.page(lane, page._replace(rows=rows))
            self._losses.note_saved(page.losses)
            is_read = True
        if is_read:
            self._wake()
            self._note_work()

    def _steady_s(self, utc_s: float) -> float:
        """Return a wall time of the past on the steady clock; the future counts as now."""
        return self._clock.now_s() - max(0.0, self._clock.utc_s() - utc_s)

    def _declare(self) -> None:
        """Tell what was lost, as soon as there is somebody to tell."""
        if self._outbox.is_connected:
            now_s = self._clock.now_s()
            if declaration := self._losses.declare(now_s):
                self._tell("gap", Severity.WARNING, *declaration)
            elif wait_s := self._losses.wait_s(now_s):
                asyncio.get_running_loop().call_later(wait_s, self._work.set)

    def _tell_refused(self) -> None:
        """Tell, once an hour, that the broker refuses what we publish; the rest is counted."""
        now_s = self._clock.now_s()
        count = self._outbox.refused - self._refused
        if count and now_s - self._refused_told_s >= REFUSED_EVERY_S:
            self._refused += count
            self._refused_told_s = now_s
            topic, code = self._outbox.refusals[-1]
            text = f"the broker refused {count} messages, the last on {topic}: look at its access list"
            data = {"count": count, "topic": topic, "reason_code": code}
            self._tell("publish_refused", Severity.ERROR, text, data)
