"""The state of a gateway: its commands, documents and audit, in one file with one thread.

Nothing of it ever prevents the gateway's start or stop. Its news become events.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from gateway.contract import EventCode, PublishEvent
from gateway.store.audit import Audit
from gateway.store.commands import Journal, Remembered
from gateway.store.documents import Documents
from gateway.store.import_0_2 import import_files
from gateway.store.schema import STATE
from gateway.store.worker import News, OnNews, Store
from gateway.system.supervised import on_this_loop

log = logging.getLogger(__name__)

CLOSE_WITHIN_S = 4.0
SETTLE_WITHIN_S = 2.0


class StateStore:
    """All calls on the app's loop; `path` None: in memory."""

    def __init__(self, path: Path | None, *, boot: str, publish_event: PublishEvent) -> None:
        self._publish_event = publish_event
        prepare = partial(import_files, None if path is None else path.parent)
        self.store = Store(path, STATE, prepare=prepare)
        self.documents = Documents(self.store, path, publish_event=publish_event)
        self.commands = Journal(self.store, publish_event=publish_event)
        self.audit = Audit(self.store, boot=boot)
        self.on_news: OnNews = lambda *_: None  # gets the store's news after the parts of this

    def start(self, version: str, *, on_recalled: Callable[[Sequence[Remembered]], None]) -> None:
        """Begin; the file is opened in its thread. `on_recalled` gets the commands of earlier runs."""
        self.commands.recall(on_recalled)
        self.store.start(on_this_loop(self._on_news))
        self.audit.note("gateway_started", f"version {version}")

    async def settle(self) -> None:
        """Write the last results and documents, if the disk works, so that they can be published."""
        await asyncio.gather(self.documents.close(), self.commands.settle(SETTLE_WITHIN_S))

    async def close(self, reason: str) -> None:
        """Write what waits, as far as the disk lets us."""
        self.audit.note("gateway_ended", reason)
        is_done = await asyncio.to_thread(self.store.close, within_s=CLOSE_WITHIN_S)
        if not is_done or self.store.unsaved:
            log.error("the last %d commands, documents and audit entries are not stored", self.store.unsaved)

    def _on_news(self, news: News, text: str) -> None:
        match news:
            case News.OPEN:
                log.info("store %s", text)
            case News.BACK:
                self._publish_event(EventCode.STORE_AVAILABLE)
            case News.AWAY:
                self._publish_event(EventCode.STORE_UNAVAILABLE, trouble=text)
            case News.LOST:
                self._publish_event(EventCode.STORE_LOST, trouble=text)
                self.audit.note("chain_begun_anew", text)
                self.documents.save_all()
        self.on_news(news, text)
