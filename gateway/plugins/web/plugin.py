"""The status page as an integration: fed with records, and with every message as MQTT gets it."""

from __future__ import annotations

import importlib
import logging
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gateway import __version__
from gateway.config.convert import policy_of
from gateway.config.integration_tables import WebTable
from gateway.config.schema import Config
from gateway.config.values import split_listen
from gateway.contract import CONTRACT_VERSION, EventCode, Record, event_of
from gateway.families.profile.load import load_profile
from gateway.plugins.interface import Gateway, Plugin, PluginSite
from gateway.plugins.web.access import WebAccess
from gateway.plugins.web.interface import WebSettings, WebUser
from gateway.plugins.web.site_model import ShownSite

if TYPE_CHECKING:
    from gateway.plugins.web.service import WebService

log = logging.getLogger(__name__)

MISSING = event_of(EventCode.WEB_AWAY, "missing")


class PageService:
    """The page while it is served; implements `Plugin`. `module` is `gateway.plugins.web.service`."""

    def __init__(self, site: PluginSite, module: Any, gateway: Gateway) -> None:
        self._site = site
        self._access = WebAccess(site, gateway)
        self._publish_event = gateway.publish_event
        settings, shown = _shown(site)
        self._page: WebService = module.WebService(
            settings,
            shown,
            self._access,
            gateway.clock,
            on_trouble=self._note_trouble,
            on_old_certificate=self._note_old_certificate,
            make_server=gateway.make_web_server,
        )
        for record in gateway.latest.records():
            self._page.put(record)

    @property
    def streams(self) -> int:
        """Return how many pages are open."""
        return self._page.streams

    def put(self, record: Record) -> None:
        """Take a record."""
        self._page.put(record)

    def reconfigure(self, site: PluginSite) -> None:
        """Follow another configuration."""
        self._site = self._access.site = site
        self._page.move(*_shown(site))

    async def run(self) -> None:
        """Serve until cancelled."""
        await self._page.run()

    def _note_trouble(self, trouble: str) -> None:
        if trouble:
            self._publish_event(EventCode.WEB_AWAY, "trouble", trouble=trouble)
        else:
            url = _shown(self._site)[0].url
            log.info("status page at %s", url)
            self._publish_event(EventCode.WEB_OPEN, url=url)

    def _note_old_certificate(self, trouble: str) -> None:
        self._publish_event(EventCode.WEB_CERTIFICATE, trouble=trouble)


def load(gateway: Gateway) -> Callable[[PluginSite], Plugin]:
    """Import what the page needs, and return what makes it."""
    module = importlib.import_module("gateway.plugins.web.service")
    return lambda site: PageService(site, module, gateway)


def settings_of(site: PluginSite) -> PluginSite | None:
    """Return the site while it has a page."""
    return None if site.config.web is None else site


def _shown(site: PluginSite) -> tuple[WebSettings, ShownSite]:
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
