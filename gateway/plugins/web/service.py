"""The page as one service: made once the lines poll, changed by a reload, ended with the gateway."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from typing import Any

from gateway.contract import Record
from gateway.plugins.web.accounts import Accounts
from gateway.plugins.web.application import WebApp
from gateway.plugins.web.interface import GatewayAccess, WebSettings
from gateway.plugins.web.routes import Routes
from gateway.plugins.web.server import Server
from gateway.plugins.web.site_model import ShownSite, SiteModel
from gateway.plugins.web.static_files import read_files
from gateway.plugins.web.streams import Streams
from gateway.system.clock import Clock

log = logging.getLogger(__name__)

RETRY_S = 5.0


class WebService:
    """On the application's loop. `on_trouble` gets why the page cannot be served; empty once it can.

    `on_old_certificate` gets why the certificate's files cannot be used, so that the one before goes on.
    """

    def __init__(
        self,
        settings: WebSettings,
        site: ShownSite,
        access: GatewayAccess,
        clock: Clock,
        *,
        on_trouble: Callable[[str], None],
        on_old_certificate: Callable[[str], None] = lambda _: None,
        make_server: Callable[[Any, WebSettings], Server] | None = None,
    ) -> None:
        self._settings = settings
        self._clock = clock
        self._on_trouble = on_trouble
        self._on_old_certificate = on_old_certificate
        self.model = SiteModel(site)
        self._accounts = Accounts(settings, access, clock)
        self._streams = Streams(self.model, access, clock, is_logged_in=self._accounts.is_logged_in)
        self._access = access
        self._page: WebApp | None = None
        self._server: Server | None = None
        self._serving: asyncio.Task[None] | None = None
        self._renewing: asyncio.Task[None] | None = None
        self._is_moved = False
        self._make_server = make_server or Server

    @property
    def address(self) -> tuple[str, int] | None:
        """Return where the page listens; None while it does not."""
        return None if self._server is None else self._server.address

    @property
    def streams(self) -> int:
        """Return how many pages are open."""
        return len(self._streams)

    def put(self, record: Record) -> None:
        """Take a record."""
        self.model.put(record, self._clock.now_s())
        self._streams.note_change()

    def move(self, settings: WebSettings, site: ShownSite) -> None:
        """Show another configuration; only another address, or other files of it, ends the connections.

        The certificate's files are read again: they may have been renewed.
        """
        is_elsewhere = settings.endpoint != self._settings.endpoint
        self._settings = settings
        self.model.move(site)
        self._accounts.move(settings)
        if self._page is not None:
            self._page.settings = settings
        self._streams.restart()
        if is_elsewhere and self._serving is not None:
            self._is_moved = True
            self._streams.end()
            self._serving.cancel()
        elif settings.is_tls and self._server is not None:
            self._renewing = asyncio.create_task(self._renew(self._server), name="web certificate")

    async def run(self) -> None:
        """Serve until cancelled; an address or certificate that cannot be used is tried again."""
        routes = Routes(
            model=self.model,
            access=self._access,
            accounts=self._accounts,
            streams=self._streams,
            files=await asyncio.to_thread(read_files),
            clock=self._clock,
        )
        self._page = WebApp(self._settings, routes.router)
        while True:
            self._server = self._make_server(self._page, self._settings)
            self._serving = asyncio.create_task(self._server.run(), name="web server")
            reporting = asyncio.create_task(self._report_success(self._server))
            try:
                await asyncio.wait((self._serving,))
            finally:
                reporting.cancel()
                self._streams.end()
                self._serving.cancel()
                await asyncio.wait((self._serving,))
            if self._is_moved:
                self._is_moved = False
                continue
            error = None if self._serving.cancelled() else self._serving.exception()
            if not isinstance(error, OSError):  # ssl.SSLError is one
                raise error or asyncio.CancelledError
            self._on_trouble(f"{self._settings.host}:{self._settings.port}: {error.strerror or error}")
            await asyncio.sleep(RETRY_S)

    async def _renew(self, server: Server) -> None:
        try:
            await server.renew()
        except OSError as error:
            self._on_old_certificate(error.strerror or str(error))

    async def _report_success(self, server: Server) -> None:
        await server.is_open.wait()
        self._on_trouble("")
