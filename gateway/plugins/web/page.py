"""The status page while it is served: fed with records, reconfigured by a reload, ended with the gateway."""

from __future__ import annotations

import asyncio
import logging

from gateway.contract import EventCode, Record
from gateway.plugins.interface import Gateway
from gateway.plugins.web.accounts import Accounts
from gateway.plugins.web.acknowledged import Acknowledged
from gateway.plugins.web.control import Control
from gateway.plugins.web.plugin import WebSettings
from gateway.plugins.web.routes import WebApp
from gateway.plugins.web.server import Server
from gateway.plugins.web.site_model import SiteModel
from gateway.plugins.web.static_files import read_files
from gateway.plugins.web.streams import Streams
from gateway.system.supervised import until_first

log = logging.getLogger(__name__)

RETRY_S = 5.0


class Page:
    """Implements `Plugin`; on the application's loop."""

    def __init__(self, gateway: Gateway, settings: WebSettings) -> None:
        self._gateway = gateway
        self._settings = settings
        self._changed = asyncio.Event()  # the settings
        self._model = SiteModel(settings, gateway.latest, Acknowledged(gateway))
        self._accounts = Accounts(settings, gateway.records)
        self._control = Control(gateway)
        self._streams = Streams(self._model, self._control, self._accounts, gateway)

    @property
    def streams(self) -> int:
        """Return how many pages are open."""
        return len(self._streams)

    def put(self, record: Record) -> None:
        """Take a record."""
        self._model.put(record)
        self._streams.note_change()

    def reconfigure(self, settings: WebSettings) -> None:
        """Show another configuration; only another address, or other files of it, ends the connections."""
        self._settings = settings
        self._model.reconfigure(settings)
        self._accounts.reconfigure(settings)
        self._streams.restart()
        self._changed.set()

    async def run(self) -> None:
        """Serve until cancelled; an address or certificate that cannot be used is tried again."""
        files = await asyncio.to_thread(read_files)
        app = WebApp(self._gateway, self._model, self._control, self._accounts, self._streams, files)
        last = ""
        while True:
            self._changed.clear()
            settings = self._settings
            server = (self._gateway.make_web_server or Server)(app, settings)
            try:
                await until_first(server.run(), self._until_moved(server, settings))
            except OSError as error:  # ssl.SSLError is one
                trouble = f"{settings.host}:{settings.port}: {error.strerror or error}"
                if trouble != last or server.is_open.is_set():  # said once, tried again and again
                    self._gateway.publish_event(EventCode.WEB_AWAY, "trouble", trouble=trouble)
                last = trouble
                await asyncio.sleep(RETRY_S)

    async def _until_moved(self, server: Server, settings: WebSettings) -> None:
        """Return when the page is to be served elsewhere; its streams have ended then.

        With each change the certificate's files are read again: they may have been renewed.
        """
        try:
            await server.is_open.wait()
            log.info("status page at %s", settings.url)
            self._gateway.publish_event(EventCode.WEB_OPEN, url=settings.url)
            while True:
                await self._changed.wait()
                self._changed.clear()
                if self._settings.endpoint != settings.endpoint:
                    return
                if settings.is_tls:
                    await self._renew(server)
        finally:
            self._streams.end()

    async def _renew(self, server: Server) -> None:
        try:
            await server.renew()
        except OSError as error:
            trouble = error.strerror or str(error)
            self._gateway.publish_event(EventCode.WEB_CERTIFICATE, trouble=trouble)
