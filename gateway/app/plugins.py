"""Runs the plugins beside everything else: each is found by its table, imported late, fed, begun again.

1. A plugin runs as long as the configuration wants it; a reload begins, changes or ends it. It begins, and
   imports what it needs, once the lines poll.
2. Each has a bounded queue. Of values the newest wins; everything else comes in order, and what did not fit
   is declared by an event.
3. A bug in it ends it alone, for `RESTART_PAUSE_S`: the lines, the commands and the others do not notice.
4. A package that it needs and is not installed is said once, by an event.
"""

from __future__ import annotations

import asyncio
import importlib
import logging
from collections.abc import Callable
from functools import partial
from typing import Any, Protocol

from gateway.app.site import Site
from gateway.contract import Event, EventCode, Record, ValueRecord
from gateway.plugins.interface import Gateway, Plugin, PluginSite
from gateway.system.supervised import RESTART_PAUSE_S, until_first

log = logging.getLogger(__name__)

NAMES = ("web", "homeassistant", "metrics", "sparkplug")  # in which order they get records
POLLING_WITHIN_S = 10.0  # then it begins although a line does not move: it shows why
LOOK_S = 0.1
MOST = 5000  # records that wait for a plugin
AT_ONCE = 200  # of them, until the loop does something else


class PluginModule(Protocol):
    """What `gateway.plugins.NAME.plugin` has."""

    MISSING: Event | None  # an event that says what to install

    def settings_of(self, site: PluginSite) -> Any:
        """Return the plugin's settings; None while the configuration does not want it."""

    def load(self, gateway: Gateway) -> Callable[[Any], Plugin]:
        """Import what the plugin needs, in a thread, and return what makes it of its settings."""


def module_of(name: str) -> PluginModule:
    """Return the module of a plugin."""
    module: Any = importlib.import_module(f"gateway.plugins.{name}.plugin")
    return module  # type: ignore[no-any-return]


class PluginQueue:
    """The records that wait for one plugin."""

    def __init__(self) -> None:
        self.lost = 0  # since this was looked at
        self.has_news = asyncio.Event()
        self._waiting: dict[object, Record] = {}  # values by their topic, in order

    def put(self, record: Record) -> None:
        """Take a record; the oldest goes when there is no room."""
        key: object = record.topic if isinstance(record, ValueRecord) else object()
        self._waiting.pop(key, None)
        if len(self._waiting) >= MOST:
            del self._waiting[next(iter(self._waiting))]
            self.lost += 1
        self._waiting[key] = record
        self.has_news.set()

    def take(self) -> Record | None:
        """Return the record that has waited longest; None when there is none."""
        if not self._waiting:
            self.has_news.clear()
            return None
        return self._waiting.pop(next(iter(self._waiting)))


class PluginRunner:
    """One plugin while it is wanted; a sink of records. On the app's loop."""

    def __init__(self, name: str, site: Site, gateway: Gateway) -> None:
        self.name = name
        self.plugin: Plugin | None = None  # that takes records now
        self._module = module_of(name)
        self._gateway = gateway
        self._site = site
        self._queue = PluginQueue()
        self._changed = asyncio.Event()  # the configuration, or the plugin has failed

    def put(self, record: Record) -> None:
        """Take a record; nothing waits for a plugin that does not run."""
        if self.plugin is not None:
            self._queue.put(record)

    def reconfigure(self, site: Site) -> None:
        """Follow another configuration: begin, change or end the plugin."""
        self._site = site
        settings = self._module.settings_of(site)
        if self.plugin is None or settings is None:
            self._changed.set()
            return
        try:
            self.plugin.reconfigure(settings)
        except Exception:
            log.exception("plugin=%s could not follow the configuration", self.name)
            self.plugin = None
            self._changed.set()

    async def run(self) -> None:
        """Serve until cancelled, while the configuration wants it."""
        while True:
            self._changed.clear()
            if self._module.settings_of(self._site) is None or not await self._served():
                await self._changed.wait()

    async def _served(self) -> bool:
        """Serve until the configuration no longer wants it, or a bug; return False when it cannot begin."""
        await self._until_polling()
        try:
            make = await self._gateway.in_thread(partial(self._module.load, self._gateway))
        except ImportError as error:
            if self._module.MISSING is None:
                raise
            log.error("%s (%s)", self._module.MISSING.text, error)  # noqa: TRY400 - it says it all
            self._gateway.publish_event(self._module.MISSING)
            return False
        settings = self._module.settings_of(self._site)
        self._changed.clear()  # whatever changed so far is in these settings
        if settings is None:
            return True
        try:
            self._queue = PluginQueue()
            self._gateway.latest.begin()
            self.plugin = plugin = make(settings)
            await until_first(plugin.run(), self._feed(plugin), self._changed.wait())
            if self.plugin is plugin and self._changed.is_set():
                return True
        except Exception:
            log.exception("plugin=%s ended by a bug and begins again", self.name)
        finally:
            self.plugin = None
        await asyncio.sleep(RESTART_PAUSE_S)
        return True

    async def _feed(self, plugin: Plugin) -> None:
        """Hand records on as they come; a few at a time, so that nothing else waits for a plugin."""
        while True:
            await self._queue.has_news.wait()
            for _ in range(AT_ONCE):
                record = self._queue.take()
                if record is None:
                    break
                plugin.put(record)
            if self._queue.lost:
                lost, self._queue.lost = self._queue.lost, 0
                self._gateway.publish_event(EventCode.PLUGIN_BEHIND, plugin=self.name, records=lost)
            await asyncio.sleep(0)

    async def _until_polling(self) -> None:
        for _ in range(int(POLLING_WITHIN_S / LOOK_S)):
            if all(self._gateway.progress().values()):
                return
            await asyncio.sleep(LOOK_S)
