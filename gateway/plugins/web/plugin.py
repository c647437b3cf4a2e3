"""What the gateway knows of its status page while none is wanted: its settings, and how it is loaded.

The page itself stands in `page`, which is imported late: its web server is no small package.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from gateway.config import Config, policy_of, split_listen
from gateway.contract import EventCode, event_of
from gateway.families import load_profile
from gateway.plugins.interface import Gateway, Plugin, PluginSite

MISSING = event_of(EventCode.WEB_AWAY, "missing")


@dataclass(frozen=True, slots=True)
class WebUser:
    """A login and the operator whose rights it has."""

    name: str
    client: str
    password_line: str = field(repr=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class WebSettings:
    """Where the page listens, how it is called, who may log in, and what it shows of the configuration."""

    host: str = "127.0.0.1"
    port: int = 8480
    hosts: tuple[str, ...] = ()  # names that the page is called by, besides localhost and its addresses
    base_path: str = "/"  # begins and ends with a slash
    cert_file: str | None = None
    key_file: str | None = None
    trusted_proxies: tuple[str, ...] = ()
    pages_per_address: int = 32  # that are open at a time; as many per login
    users: Mapping[str, WebUser] = field(default_factory=dict)
    starters: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    lines: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    groups: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    config: Config
    path: Path | None = None  # of the configuration's file
    computed: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)  # by line, for a bug report

    @property
    def is_tls(self) -> bool:
        """Return whether the page itself speaks TLS."""
        return self.cert_file is not None

    @property
    def endpoint(self) -> tuple[str, int, str | None, str | None]:
        """Return what the listening socket depends on: another one needs another socket."""
        return self.host, self.port, self.cert_file, self.key_file

    @property
    def url(self) -> str:
        """Return the page's address on this machine."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{'https' if self.is_tls else 'http'}://{host}:{self.port}{self.base_path}"


def settings_of(site: PluginSite) -> WebSettings | None:
    """Return what the page runs by; None while the configuration has no [web]."""
    config, web = site.config, site.config.web
    if web is None:
        return None
    host, port = split_listen(web.listen) or ("127.0.0.1", 0)
    members = policy_of(config).groups
    cert, key = (None if name is None else str(site.folder / name) for name in (web.cert_file, web.key_file))
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
        starters={
            starter.name: {
                "line": line.name,
                "address": starter.address,
                "family": starter.family,
                "kind": load_profile(starter.family).title,
                "title": starter.title or starter.name,
                "enabled": starter.enabled,
            }
            for line in config.lines
            for starter in line.starters
        },
        lines={
            line.name: {
                "title": line.title or line.name,
                "port": line.port,
                "baud": line.baud,
                "framing": line.framing,
                "starters": [starter.name for starter in line.starters],
            }
            for line in config.lines
        },
        groups={
            group.name: {"title": group.title or group.name, "starters": members[group.name]}
            for group in config.groups
        },
        config=config,
        path=site.path,
        computed=site.computed,
    )


def load(gateway: Gateway) -> Callable[[WebSettings], Plugin]:
    """Import what the page needs, and return what makes it."""
    return partial(importlib.import_module("gateway.plugins.web.page").Page, gateway)
