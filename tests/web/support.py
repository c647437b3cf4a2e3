"""The page without sockets: a gateway in a few lines, a clock set by hand, and an ASGI client."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import unquote

from gateway.mqtt.contract.payloads import Payloads
from gateway.plugins.web.commands import PendingCommands

from gateway.contract import Quality, Record, SequenceNumbers, StateRecord, Topics, ValueRecord
from gateway.plugins.web.accounts import Accounts
from gateway.plugins.web.application import WebApp
from gateway.plugins.web.interface import WebSettings, WebUser
from gateway.plugins.web.routes import Routes
from gateway.plugins.web.site_model import ShownSite, SiteModel
from gateway.plugins.web.static_files import StaticFile
from gateway.plugins.web.streams import Streams
from gateway.system.clock_steps import ClockReading

HOST = "127.0.0.1:8480"
ORIGIN = f"http://{HOST}"
USER = WebUser("anna", "alice", "line-of-anna")
SETTINGS = WebSettings(users={"anna": USER})


def shown_site(*starters: str, groups: Mapping[str, tuple[str, ...]] | None = None) -> ShownSite:
    names = starters or ("pump-1", "pump-2")
    facts = {
        name: {"line": "pumps", "address": place, "family": "ssw07", "title": "WEG", "enabled": True}
        for place, name in enumerate(names, 1)
    }
    lines = {"pumps": {"port": "/dev/x", "baud": 19200, "framing": "8E1", "starters": list(names)}}
    return ShownSite("mcc1", "starters/mcc1", "0.1.0", 1, facts, lines, groups or {})


class HandClock:
    """A clock that a test sets."""

    def __init__(self) -> None:
        self.s = 1000.0

    def now_s(self) -> float:
        return self.s

    def utc_s(self, at_s: float | None = None) -> float:
        return 1_760_000_000.0 + (self.s if at_s is None else at_s)

    def reading(self) -> ClockReading:
        return ClockReading(self.s, self.utc_s(), "boot-1")


@dataclass
class FakeAccess:
    """A gateway that records what the page asks of it; a command ends as `ends` says."""

    commands: list[tuple[str, str, bytes, str, str]] = field(default_factory=list)
    logins: list[tuple[str, str, str, str, str]] = field(default_factory=list)
    offers: list[dict[str, Any]] = field(default_factory=list)
    results: PendingCommands | None = None
    phases: tuple[str, ...] = ("accepted", "confirmed")
    tokens: int = 0

    def token(self) -> str:
        return f"token-{self.tokens}"

    def may_start(self, client: str) -> bool:
        return client == "alice"

    def actions(self, starter: str, client: str | None) -> list[dict[str, Any]]:
        return [{**offer, "client": client} for offer in self.offers]

    def submit(
        self, starter: str, verb: str, body: bytes, *, client: str, user: str, correlation: bytes
    ) -> None:
        self.commands.append((starter, verb, body, client, user))
        for phase in self.phases:
            assert self.results is not None
            payload = json.dumps({"phase": phase}).encode()
            self.results.put(correlation, f"result/{starter}/{client}", payload)

    def note_login(self, verb: str, code: str, *, user: str, client: str, address: str) -> None:
        self.logins.append((verb, code, user, client, address))

    async def parameters(self, starter: str) -> list[dict[str, Any]]:
        return [{"code": "P314"}]

    async def records(self, starter: str) -> Mapping[str, list[Any]] | None:
        return None

    def metrics(self) -> None:
        return None

    async def health(self) -> Mapping[str, Any]:
        return {"lines": {"pumps": True}, "broker": True}

    def about(self) -> dict[str, Any]:
        return {"clock": {"doubt": None}}

    def diagnostics(self) -> dict[str, Any]:
        return {"config": {}}

    async def run_tool(self, name: str) -> dict[str, Any]:
        return {"code": 0, "output": name}


@dataclass
class Answer:
    """What came back."""

    status: int
    headers: dict[str, str]
    body: bytes

    @property
    def json(self) -> Any:
        return json.loads(self.body)


class PageRig:
    """A page with everything behind it."""

    def __init__(
        self,
        settings: WebSettings = SETTINGS,
        *,
        site: ShownSite | None = None,
        files: Mapping[str, StaticFile] | None = None,
        clock: Any = None,
    ) -> None:
        self.clock = clock or HandClock()
        self.access = FakeAccess()
        self.model = SiteModel(site or shown_site())
        self.accounts = Accounts(settings, self.access, self.clock, check=self._check)
        self.commands = self.access.results = PendingCommands()
        self.streams = Streams(self.model, self.access, self.clock, is_logged_in=self.accounts.is_logged_in)
        routes = Routes(
            model=self.model,
            access=self.access,
            accounts=self.accounts,
            streams=self.streams,
            commands=self.commands,
            files=files or {},
            clock=self.clock,
        )
        self.page = WebApp(settings, routes.router)
        self.cookie = self.csrf = ""
        self._payloads = Payloads(Topics("starters/mcc1"), "boot")
        self._sequence = SequenceNumbers()

    def publish(self, record: Record) -> bytes:
        """Publish a record as the gateway does; return its payload."""
        message = self._payloads.message(record)
        self.model.publish(message.topic, message.payload, is_retained=message.retain)
        self.model.put(record, self.clock.now_s())
        self.streams.note_change()
        return message.payload

    def value(self, starter: str, point: str, value: float, quality: Quality = Quality.GOOD) -> bytes:
        return self.publish(
            ValueRecord(
                starter=starter,
                point=point,
                value=value,
                unit="A",
                quality=quality,
                time_s=1.0,
                seq=self._sequence.take(),
            )
        )

    def state(self, starter: str, state: str) -> bytes:
        return self.publish(
            StateRecord(
                starter=starter, state=state, quality=Quality.GOOD, time_s=1.0, seq=self._sequence.take()
            )
        )

    async def get(self, path: str, **headers: str) -> Answer:
        return await self.ask("GET", path, headers=headers)

    async def post(self, path: str, body: object = None, **headers: str) -> Answer:
        """Post as the page does; headers are spelt with _ for -."""
        usual = {"content_type": "application/json", "origin": ORIGIN, "sec_fetch_site": "same-origin"}
        if self.csrf:
            usual["x_csrf_token"] = self.csrf
        content = body if isinstance(body, bytes) else json.dumps(body or {}).encode()
        return await self.ask("POST", path, content, headers={**usual, **headers})

    async def log_in(self, password: str = "right", user: str = "anna", **headers: str) -> Answer:
        answer = await self.post("/api/v1/login", {"user": user, "password": password}, **headers)
        if answer.status == 200:
            self.csrf = answer.json["csrf"]
            self.cookie = answer.headers["set-cookie"].split(";")[0]
        return answer

    async def ask(
        self,
        method: str,
        path: str,
        body: bytes = b"",
        *,
        headers: Mapping[str, str] | None = None,
        peer: str = "127.0.0.1",
        scheme: str = "http",
    ) -> Answer:
        """Send one request and collect the whole answer."""
        given = {"host": HOST, **({"cookie": self.cookie} if self.cookie else {}), **(headers or {})}
        sent = [(n.replace("_", "-").encode(), v.encode()) for n, v in given.items() if v]
        path, _, query = path.partition("?")
        scope = {
            "type": "http",
            "method": method,
            "path": unquote(path),
            "raw_path": path.encode(),
            "query_string": query.encode(),
            "root_path": "",
            "scheme": scheme,
            "headers": sent,
            "client": (peer, 50000),
            "server": ("127.0.0.1", 8480),
            "http_version": "1.1",
        }
        collected: list[Any] = []
        gone = asyncio.Event()
        bodies = [{"type": "http.request", "body": body, "more_body": False}]

        async def receive() -> Any:
            if bodies:
                return bodies.pop()
            await gone.wait()
            return {"type": "http.disconnect"}

        async def send(message: Any) -> None:
            collected.append(message)

        await self.page(scope, receive, send)
        start = collected[0]
        return Answer(
            start["status"],
            {name.decode(): value.decode() for name, value in start["headers"]},
            b"".join(message.get("body", b"") for message in collected[1:]),
        )

    def _check(self, password: str, line: str) -> bool:
        return (password, line) == ("right", "line-of-anna")
