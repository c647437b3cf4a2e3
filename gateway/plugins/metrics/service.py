"""The metrics as one service: counts records, makes the text of a scrape in a thread, writes it to a file.

1. The application's loop only gathers references; the text is made in a thread, one at a time.
2. A text serves every scrape of the next second: lines renew their statistics as often.
3. The file is replaced as a whole, and removed at an orderly end: node-exporter serves whatever it finds.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
import os
from collections.abc import Callable
from pathlib import Path

from gateway.contract import Record
from gateway.plugins.metrics.collector import exposition
from gateway.plugins.metrics.counts import RecordCounts
from gateway.plugins.metrics.scrape import MetricsSettings, MetricsSource
from gateway.system.clock import Clock
from gateway.system.rate_limits import ChangeDetector
from gateway.system.supervised import InThread

log = logging.getLogger(__name__)

VALID_S = 1.0
WRITE_EVERY_S = 15.0
FILE_MODE = 0o644  # node-exporter runs as another user


class MetricsService:
    """On the application's loop. `on_trouble` gets why the file cannot be written; empty once it can."""

    def __init__(
        self,
        settings: MetricsSettings,
        source: MetricsSource,
        clock: Clock,
        *,
        verbs: frozenset[str],
        on_trouble: Callable[[str], None],
        in_thread: InThread = asyncio.to_thread,
    ) -> None:
        self._settings = settings
        self._source = source
        self._clock = clock
        self._counts = RecordCounts(verbs, has_own_values=settings.has_all_points)
        self._on_trouble = on_trouble
        self._in_thread = in_thread
        self._making = asyncio.Lock()
        self._text = b""
        self._made_s = -math.inf
        self._said = ChangeDetector("")
        self._moved = asyncio.Event()
        self._path: Path | None = None  # of the file that is there

    def put(self, record: Record) -> None:
        """Take a record."""
        self._counts.put(record, self._clock.now_s())

    def reconfigure(self, settings: MetricsSettings) -> None:
        """Follow other settings; what was counted stays."""
        self._settings = settings
        self._counts.want_own_values(has_own_values=settings.has_all_points)
        self._made_s = -math.inf
        self._moved.set()

    @property
    def token(self) -> str | None:
        """Return what a scrape must carry; None: nothing."""
        return self._settings.token

    async def text(self) -> bytes:
        """Return what a scrape gets; at most a second old."""
        async with self._making:
            if self._clock.now_s() - self._made_s >= VALID_S:
                made_s = self._clock.now_s()
                scraped, counted = self._source.scraped(), self._counts.taken()
                has_all_points = self._settings.has_all_points

                def make() -> bytes:
                    return exposition(scraped, counted, has_all_points=has_all_points)

                self._text = await self._in_thread(make)
                self._made_s = made_s
            return self._text

    async def run(self) -> None:
        """Write the file, where one is wanted, until cancelled; then remove it."""
        try:
            while True:
                self._moved.clear()
                wanted = self._settings.textfile
                if wanted != self._path:
                    self._remove()
                    self._path = wanted
                if wanted is not None:
                    await self._write(wanted)
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(self._moved.wait(), None if wanted is None else WRITE_EVERY_S)
        finally:
            self._remove()

    async def _write(self, path: Path) -> None:
        text = await self.text()

        def replace() -> None:
            _replace(path, text, is_wanted=lambda: self._path == path)

        try:
            await self._in_thread(replace)
        except OSError as error:
            trouble = f"{path}: {error.strerror or error}"
        else:
            trouble = ""
        if self._said.is_new(trouble):
            self._on_trouble(trouble)

    def _remove(self) -> None:
        path, self._path = self._path, None
        if path is None:
            return
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            log.warning("the metrics' file cannot be removed: %s: %s", path, error)


def _replace(path: Path, text: bytes, *, is_wanted: Callable[[], bool]) -> None:
    """Write a file that is never seen half written; node-exporter ignores the other name."""
    other = path.with_name(f".{path.name}.new")
    descriptor = os.open(other, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_NOFOLLOW, FILE_MODE)
    with os.fdopen(descriptor, "wb") as file:
        os.fchmod(file.fileno(), FILE_MODE)
        file.write(text)
    if is_wanted():  # not removed meanwhile
        other.replace(path)
    else:
        other.unlink()
