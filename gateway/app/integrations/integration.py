"""One integration beside everything else: imported late, fed, reloaded, begun anew after a bug.

1. It runs as long as the configuration wants it; a reload begins, changes or ends it. It begins, and imports
   what it needs, once the lines poll.
2. A bug in it ends it alone, for `RESTART_PAUSE_S`: the lines, the commands and the others do not notice.
3. What it needs that is not installed is said once, by an event; everything else goes on.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from gateway.app.site import Site
from gateway.contract import Event, PublishEvent, Record
from gateway.system.clock import Clock
from gateway.system.supervised import RESTART_PAUSE_S, InThread, until_first

log = logging.getLogger(__name__)

POLLING_WITHIN_S = 10.0  # then it begins although a line does not move: it shows why
LOOK_S = 0.1

Load = Callable[[], Callable[[Any], "IntegrationService"]]


class IntegrationService(Protocol):
    """An integration while it runs; all calls on the app's loop."""

    def put(self, record: Record) -> None:
        """Take a record, in order; returns at once."""

    def move(self, settings: Any, /) -> None:
        """Follow another configuration that still wants this integration."""

    async def run(self) -> None:
        """Serve until cancelled, then end in order."""


@dataclass(frozen=True, slots=True)
class IntegrationHost:
    """What every integration begins with."""

    site: Site
    clock: Clock
    is_polling: Callable[[], bool]
    publish_event: PublishEvent
    in_thread: InThread = asyncio.to_thread


class Integration:
    """Runs one integration while it is wanted; a sink of records. On the app's loop.

    `load` imports, in a thread, what the integration needs, and returns what makes its service; `missing`
    says what to install when that fails. The service is made of what `settings_of` makes of the site, and
    given the same at each reload.
    """

    def __init__(
        self,
        name: str,
        host: IntegrationHost,
        *,
        is_wanted: Callable[[Site], bool],
        load: Load,
        missing: Event | None = None,
        settings_of: Callable[[Site], Any] = lambda site: site,
    ) -> None:
        self.name = name
        self._host = host
        self._site = host.site
        self._is_wanted = is_wanted
        self._load = load
        self._missing = missing
        self._settings_of = settings_of
        self._service: IntegrationService | None = None
        self._changed = asyncio.Event()  # the configuration, or the service has failed

    @property
    def service(self) -> IntegrationService | None:
        """Return what takes the records; None while nothing does."""
        return self._service

    def put(self, record: Record) -> None:
        """Take a record; a bug in the service ends the service, and nothing else, until it begins anew."""
        service = self._service
        if service is None:
            return
        try:
            service.put(record)
        except Exception:
            log.exception("integration=%s could not take a %s", self.name, type(record).__name__)
            self._fail()

    def move(self, site: Site) -> None:
        """Follow another configuration: begin, change or end the service."""
        self._site = site
        if self._service is None or not self._is_wanted(site):
            self._changed.set()
            return
        try:
            self._service.move(self._settings_of(site))
        except Exception:
            log.exception("integration=%s could not follow the configuration", self.name)
            self._fail()

    async def run(self) -> None:
        """Serve until cancelled, while the configuration wants it."""
        while True:
            self._changed.clear()
            if not self._is_wanted(self._site) or not await self._served():
                await self._changed.wait()

    def _fail(self) -> None:
        self._service = None
        self._changed.set()

    async def _served(self) -> bool:
        """Serve until the configuration wants it no more, or a bug; return False when it cannot begin."""
        await self._until_polling()
        try:
            make = await self._host.in_thread(self._load)
        except ImportError as error:
            if self._missing is None:
                raise
            log.error("%s (%s)", self._missing.text, error)  # noqa: TRY400 - what is missing says it all
            self._host.publish_event(self._missing)
            return False
        if not self._is_wanted(self._site):
            return True
        try:
            self._service = service = make(self._settings_of(self._site))
            if await self._ended(service):
                return True
        except Exception:
            log.exception("integration=%s ended by a bug and begins anew", self.name)
        finally:
            self._service = None
        await asyncio.sleep(RESTART_PAUSE_S)
        return True

    async def _until_polling(self) -> None:
        for _ in range(int(POLLING_WITHIN_S / LOOK_S)):
            if self._host.is_polling():
                return
            await asyncio.sleep(LOOK_S)

    async def _ended(self, service: IntegrationService) -> bool:
        """Run it; return whether it ended since it is not wanted any more, not by a bug."""
        await until_first(service.run(), self._changed.wait())
        return self._service is service and self._changed.is_set()
