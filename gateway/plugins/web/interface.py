"""What the page is given: settings in plain values, and the gateway as it sees it (`app.page.access`)."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

from gateway.contract import ResultRecord


@dataclass(frozen=True, slots=True)
class WebUser:
    """A login and the operator whose rights it has."""

    name: str
    client: str
    password_line: str = field(repr=False)


@dataclass(frozen=True, slots=True)
class WebSettings:
    """Where the page listens, how it is called, who may log in."""

    host: str = "127.0.0.1"
    port: int = 8480
    hosts: tuple[str, ...] = ()  # names that the page is called by, besides localhost and its addresses
    base_path: str = "/"  # begins and ends with a slash
    cert_file: str | None = None
    key_file: str | None = None
    trusted_proxies: tuple[str, ...] = ()
    pages_per_address: int = 32  # that are open at a time; as many per login
    users: Mapping[str, WebUser] = field(default_factory=dict)

    @property
    def is_tls(self) -> bool:
        """Return whether the page itself speaks TLS."""
        return self.cert_file is not None

    @property
    def endpoint(self) -> tuple[str, int, str | None, str | None]:
        """Return what the listening socket hangs on: where this differs, it is opened anew."""
        return self.host, self.port, self.cert_file, self.key_file

    @property
    def url(self) -> str:
        """Return the page's address on this machine."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{'https' if self.is_tls else 'http'}://{host}:{self.port}{self.base_path}"


class MetricsAccess(Protocol):
    """What answers a scrape."""

    @property
    def token(self) -> str | None:
        """What a scrape must carry; None: nothing."""

    async def text(self) -> bytes:
        """Return the metrics in Prometheus' text format."""


class GatewayAccess(Protocol):
    """The gateway as the page sees it; on the application's loop."""

    def token(self) -> str:
        """Return the proof of freshness of this moment."""

    def may_start(self, client: str) -> bool:
        """Return whether an operator may start any motor."""

    def actions(self, starter: str, client: str | None) -> list[dict[str, Any]]:
        """Return what could be commanded now, and why not; without a client that a login is needed."""

    def submit(
        self, starter: str, verb: str, payload: bytes, *, client: str, user: str
    ) -> AsyncIterator[ResultRecord]:
        """Judge a command, have it carried out, and yield its results."""

    def note_login(self, verb: str, code: str, *, user: str, client: str, address: str) -> None:
        """Record a login, a refused one, or a logout in the audit."""

    async def parameters(self, starter: str) -> list[dict[str, Any]]:
        """Return the rows of a starter's family by the manual's code."""

    async def records(self, starter: str) -> Mapping[str, list[Any]] | None:
        """Return `starts` and `trips` as they are stored; None where only the latest are known."""

    def about(self) -> dict[str, Any]:
        """Return how clock and broker are."""

    def metrics(self) -> MetricsAccess | None:
        """Return what answers a scrape; None while there are no metrics."""

    async def health(self) -> Mapping[str, Any]:
        """Return `lines`: by name, whether it moves; `broker`: whether it is connected."""

    def diagnostics(self) -> dict[str, Any]:
        """Return what a bug report needs, without secrets."""

    async def run_tool(self, name: str) -> dict[str, Any]:
        """Run `check` or `doctor` in a process of its own; ToolBusyError while one runs."""


class ToolBusyError(Exception):
    """A tool runs already."""


def dumps(value: object) -> bytes:
    """Return a value as JSON in one line."""
    return json.dumps(value, separators=(",", ":"), ensure_ascii=False, allow_nan=False).encode(
        "utf-8", "replace"
    )
