"""The metrics for Prometheus: counts records, makes the text of a scrape in a thread, writes it to a file.

1. The application's loop only gathers references; the text is made in a thread, one at a time.
2. A text serves every scrape of the next second: lines renew their statistics as often.
3. The file is replaced as a whole, and removed at an orderly end: node-exporter serves whatever it finds.
"""

from __future__ import annotations

import asyncio
import contextlib
import importlib
import logging
import math
import os
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, get_args

from gateway.config import Verb
from gateway.contract import EventCode, Record, Severity, event_of
from gateway.plugins.interface import Gateway, Plugin, PluginSite
from gateway.plugins.metrics.counts import RecordCounts
from gateway.system.rate_limits import ChangeDetector

log = logging.getLogger(__name__)

MISSING = event_of(EventCode.METRICS_AWAY, "missing", severity=Severity.ERROR)
VERBS = frozenset(get_args(Verb)) - {"*"}

VALID_S = 1.0
WRITE_EVERY_S = 15.0
FILE_MODE = 0o644  # node-exporter runs as another user


@dataclass(frozen=True, slots=True)
class MetricsSettings:
    """The settings of the metrics."""

    has_all_points: bool = False
    textfile: Path | None = None
    token: str | None = field(default=None, repr=False)  # that a scrape must carry


def settings_of(site: PluginSite) -> MetricsSettings | None:
    """Return what the metrics run by."""
    table = site.config.metrics
    if table is None:
        return None
    file = None if table.textfile is None else site.folder / table.textfile
    return MetricsSettings(table.all_points, file, site.secrets["metrics"])


def load(gateway: Gateway) -> Callable[[MetricsSettings], Plugin]:
    """Import what metrics need, and return what makes them."""
    return partial(Metrics, gateway, importlib.import_module("gateway.plugins.metrics.collector"))


class Metrics:
    """On the application's loop."""

    def __init__(self, gateway: Gateway, collector: Any, settings: MetricsSettings) -> None:
        self._gateway = gateway
        self._collector = collector
        self._settings = settings
        self.token = settings.token  # that a scrape must carry; None: nothing
        self._clock = gateway.clock
        self._counts = RecordCounts(VERBS)
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
        self._settings, self.token = settings, settings.token
        self._made_s = -math.inf
        self._moved.set()

    async def text(self) -> bytes:
        """Return what a scrape gets; at most a second old."""
        async with self._making:
            if self._clock.now_s() - self._made_s >= VALID_S:
                made_s = self._clock.now_s()
                counts, times = self._counts.counts(), self._counts.times()
                all_points = self._settings.has_all_points
                scrape = self._collector.Scrape(self._gateway, counts, times, has_all_points=all_points)
                self._text = await self._gateway.in_thread(scrape.exposition)
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
        replace = partial(_replace, path, text, is_wanted=lambda: self._path == path)
        try:
            await self._gateway.in_thread(replace)
        except OSError as error:
            trouble = f"{path}: {error.strerror or error}"
        else:
            trouble = ""
        if not self._said.is_new(trouble):
            return
        if trouble:
            self._gateway.publish_event(
                EventCode.METRICS_AWAY, "trouble", severity=Severity.WARNING, trouble=trouble
            )
        else:
            self._gateway.publish_event(EventCode.METRICS_BACK)

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
