"""The status page as an integration: fed with records, and with every message as MQTT gets it."""

from __future__ import annotations

import asyncio
import importlib
import logging
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gateway import __version__
from gateway.app.integrations.integration import Integration, IntegrationHost
from gateway.app.page.access import WebAccess
from gateway.app.site import Site
from gateway.config.convert import policy_of
from gateway.config.integration_tables import WebTable
from gateway.config.schema import Config
from gateway.config.values import split_listen
from gateway.contract import CONTRACT_VERSION, EventCode, PublishEvent, Record, event_of
from gateway.families.profile.load import load_profile
from gateway.mqtt.message import Message
from gateway.mqtt.publisher import Publisher
from gateway.system.clock import Clock
from gateway.system.supervised import until_first
from gateway.web.interface import WebSettings, WebUser
from gateway.web.site_model import ShownSite

if TYPE_CHECKING:
    from gateway.web.service import WebService

log = logging.getLogger(__name__)

NAME = "web"
NOT_INSTALLED = event_of(EventCode.WEB_AWAY, "missing")


class PageService:
    """The page while it is served; implements `IntegrationService`. `module` is `gateway.web.service`."""

    def __init__(
        self,
        site: Site,
        module: Any,
        access: WebAccess,
        *,
        publisher: Publisher,
        clock: Clock,
        publish_event: PublishEvent,
        make_server: Callable[..., Any] | None = None,
    ) -> None:
        self._site = access.site = site
        self._access = access
        self._publisher = publisher
        self._publish_event = publish_event
        self._failure: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        settings, shown = _shown(site)
        self._page: WebService = module.WebService(
            settings,
            shown,
            access,
            clock,
            on_trouble=self._note_trouble,
            on_old_certificate=self._note_old_certificate,
            make_server=make_server,
        )

    @property
    def streams(self) -> int:
        """Return how many pages are open."""
        return self._page.streams

    def put(self, record: Record) -> None:
        """Take a record."""
        self._page.put(record)

    def move(self, site: Site) -> None:
        """Follow another configuration."""
        self._site = self._access.site = site
        self._page.move(*_shown(site))

    async def run(self) -> None:
        """Serve until cancelled; raises what a message has raised in the page."""
        self._publisher.listen(self._take)
        try:
            await until_first(self._page.run(), self._failure)
        finally:
            self._publisher.listen(None)

    def _take(self, message: Message) -> None:
        if self._failure.done():
            return
        try:
            self._page.publish(
                message.topic,
                message.payload,
                is_retained=message.retain,
                correlation=message.correlation,
            )
        except Exception as error:  # noqa: BLE001 - `run` raises it
            self._failure.set_exception(error)

    def _note_trouble(self, trouble: str) -> None:
        if trouble:
            self._publish_event(EventCode.WEB_AWAY, "trouble", trouble=trouble)
        else:
            url = _shown(self._site)[0].url
            log.info("status page at %s", url)
            self._publish_event(EventCode.WEB_OPEN, url=url)

    def _note_old_certificate(self, trouble: str) -> None:
        self._publish_event(EventCode.WEB_CERTIFICATE, trouble=trouble)


def page_integration(
    host: IntegrationHost,
    access: WebAccess,
    *,
    publisher: Publisher,
    make_server: Callable[..., Any] | None = None,
) -> Integration:
    """Return the page as an integration; its packages are imported once it is wanted, in a thread."""

    def load() -> Callable[[Site], PageService]:
        module = importlib.import_module("gateway.web.service")
        return lambda present: PageService(
            present,
            module,
            access,
            publisher=publisher,
            clock=host.clock,
            publish_event=host.publish_event,
            make_server=make_server,
        )

    return Integration(
        NAME, host, is_wanted=lambda each: each.config.web is not None, load=load, missing=NOT_INSTALLED
    )


def open_pages(page: Integration) -> int | None:
    """Return how many pages are open; None while none is served."""
    return page.service.streams if isinstance(page.service, PageService) else None


def _shown(site: Site) -> tuple[WebSettings, ShownSite]:
    web = site.config.web
    if web is None:
        raise ValueError("there is no [web]")
    return web_settings_of(web, site.folder), shown_site_of(site.config)


def web_settings_of(web: WebTable, folder: Path) -> WebSettings:
    """Return what the page runs by; `folder` is the configuration's."""
    host, port = split_listen(web.listen) or ("127.0.0.1", 0)
    cert, key = (None if name is None else str(folder / name) for name in (web.cert_file, web.key_file))
    return WebSettings(
        host=host,
        port=port,
        hosts=web.hosts,
        base_path=f"{web.base_path.rstrip('/')}/",
        cert_file=cert,
        key_file=key,
        trusted_proxies=web.trusted_proxies,
        pages_per_address=web.pages_per_address,
        users={user.name: WebUser(user.name, user.operator, user.password) for user in web.users},
    )


def shown_site_of(config: Config) -> ShownSite:
    """Return what the page shows of a configuration."""
    starters = {
        starter.name: {
            "line": line.name,
            "address": starter.address,
            "family": starter.family,
            "title": load_profile(starter.family).title,
            "enabled": starter.enabled,
        }
        for line in config.lines
        for starter in line.starters
    }
    lines = {
        line.name: {
            "port": line.port,
            "baud": line.baud,
            "framing": line.framing,
            "starters": [starter.name for starter in line.starters],
        }
        for line in config.lines
    }
    return ShownSite(
        gateway=config.gateway.name,
        base=config.base,
        version=__version__,
        contract=CONTRACT_VERSION,
        starters=starters,
        lines=lines,
        groups=policy_of(config).groups,
    )
