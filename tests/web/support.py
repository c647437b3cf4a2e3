"""The page without a gateway: one in a few lines, and a clock set by hand."""

from __future__ import annotations

from collections.abc import AsyncIterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, cast

from gateway.app.record_log import log_failure
from gateway.contract import (
    AuditRecord,
    Latest,
    Phase,
    Quality,
    Record,
    RecordWriter,
    ResultRecord,
    StateRecord,
    ValueRecord,
)
from gateway.errors import StoreError
from gateway.plugins.web.accounts import Accounts, WebSession
from gateway.plugins.web.acknowledged import Acknowledged
from gateway.plugins.web.plugin import WebSettings, WebUser
from gateway.plugins.web.routes import WebApp
from gateway.plugins.web.site_model import SiteModel
from gateway.plugins.web.static_files import StaticFile
from gateway.plugins.web.streams import Streams
from gateway.store import Documents
from tests.config.sites import site
from tests.virtual_time import HandClock

USER = WebUser("anna", "alice", "line-of-anna")


def web_settings(*starters: str, **fields: Any) -> WebSettings:
    """Return settings of a page that shows these starters; Anna may log in."""
    names = starters or ("pump-1", "pump-2")
    facts = {
        name: {"line": "pumps", "address": place, "family": "ssw07", "title": name, "enabled": True}
        for place, name in enumerate(names, 1)
    }
    lines = {"pumps": {"port": "/dev/x", "baud": 19200, "framing": "8E1", "starters": list(names)}}
    made = WebSettings(config=site(), users={"anna": USER}, starters=facts, lines=lines)
    return replace(made, **fields)


@dataclass
class FakeControl:
    """Records what the page commands; a command ends at once, confirmed."""

    commands: list[tuple[str, str, bytes, str, str]] = field(default_factory=list)
    offers: list[dict[str, Any]] = field(default_factory=list)

    def token(self) -> str:
        return "token-0"

    def actions(self, starter: str, client: str | None) -> list[dict[str, Any]]:
        return [{**offer, "client": client} for offer in self.offers]

    async def submit(
        self, starter: str, verb: str, body: bytes, session: WebSession
    ) -> AsyncIterator[ResultRecord]:
        user = session.user
        self.commands.append((starter, verb, body, user.client, user.name))
        named: Any = {"starter": starter, "client": user.client, "verb": verb, "id": None}
        for phase in (Phase.ACCEPTED, Phase.CONFIRMED):
            yield ResultRecord(**named, phase=phase, code="ok", text="", time_s=0.0)


@dataclass
class FakeGateway:
    """The gateway as the page sees it, commands apart; of its records it holds all."""

    clock: Any
    published: list[Record] = field(default_factory=list)
    latest: Latest = field(default_factory=Latest)

    def __post_init__(self) -> None:
        self.records = RecordWriter(self.clock, log_failure)
        self.records.connect(self)
        self.starters: dict[str, Any] = {}
        self.documents = Documents()

    def put(self, record: Record) -> None:
        self.published.append(record)
        self.latest.put(record)

    @property
    def logins(self) -> list[str]:
        """Return the code of each login and logout."""
        return [each.code for each in self.published if isinstance(each, AuditRecord)]

    async def stored(self, *_: Any) -> Any:
        raise StoreError("there is no history")


class PageRig:
    """A page with everything behind it."""

    def __init__(
        self, settings: WebSettings | None = None, files: Mapping[str, StaticFile] | None = None
    ) -> None:
        settings = settings or web_settings()
        self.clock = HandClock(1000.0)
        self.gateway = cast("Any", FakeGateway(self.clock))
        self.control = cast("Any", FakeControl())
        self.model = SiteModel(settings, self.gateway.latest, Acknowledged(self.gateway))
        self.accounts = Accounts(settings, self.gateway.records, check=self._check)
        self.streams = Streams(self.model, self.control, self.accounts, self.gateway)
        self.page = WebApp(self.gateway, self.model, self.control, self.accounts, self.streams, files or {})

    def publish(self, record: Record) -> None:
        """Publish a record as the gateway does."""
        self.gateway.put(record)
        self.model.put(record)
        self.streams.note_change()

    def value(self, starter: str, point: str, value: float, quality: Quality = Quality.GOOD) -> None:
        seq = next(self.gateway.records.sequence)
        named = {"starter": starter, "point": point, "unit": "A"}
        self.publish(ValueRecord(**named, value=value, quality=quality, time_s=1.0, seq=seq))

    def state(self, starter: str, state: str) -> None:
        seq = next(self.gateway.records.sequence)
        self.publish(StateRecord(starter=starter, state=state, quality=Quality.GOOD, time_s=1.0, seq=seq))

    def _check(self, password: str, line: str) -> bool:
        return (password, line) == ("right", "line-of-anna")
