"""The MQTT layer put together as the application does it, with everything it receives written down."""

from __future__ import annotations

import asyncio
from types import TracebackType

from gateway.mqtt.connection.broker import BrokerConnection
from gateway.mqtt.connection.reconnect import Notice, Version
from gateway.mqtt.connection.settings import BrokerSettings
from gateway.mqtt.contract.commands import CommandParser, Incoming, Rejection
from gateway.mqtt.contract.freshness import Moment, RunToken, Tokens
from gateway.mqtt.contract.payloads import Message, Payloads
from gateway.mqtt.contract.topics import Topics
from gateway.mqtt.outbox.outbox import Outbox
from gateway.mqtt.publisher import Publisher
from gateway.records import EventRecord, Quality, Severity, ValueRecord
from gateway.system.clock import SystemClock

PATIENCE_S = 10.0


def settings(port: int, **changes: object) -> BrokerSettings:
    given: dict[str, object] = {
        "host": "127.0.0.1",
        "port": port,
        "client_id": "mcc1",
        "first_retry_s": 0.02,
        "last_retry_s": 0.1,
        **changes,
    }
    return BrokerSettings(**given)  # type: ignore[arg-type]  # checked by the tests that use it


class MqttRig:
    """A gateway that is nothing but its MQTT layer; its tokens die with a connection, as they should."""

    def __init__(self, how: BrokerSettings) -> None:
        self.topics = Topics("b")
        self.boot = RunToken("boot-1")
        self.tokens = Tokens(self.boot)
        self.intake = CommandParser(self.topics, self.tokens)
        self.payloads = Payloads(self.topics, "boot-1")
        self.outbox = Outbox(last_topic=self.topics.gateway_status, pack=self.payloads.history, boot="boot-1")
        self.outbox.grant_history(10**6)  # no one paces what is reported late
        self.publisher = Publisher(self.payloads, self.outbox, SystemClock())
        self.links: asyncio.Queue[tuple[bool, str]] = asyncio.Queue()
        self.versions: list[Version] = []  # of the connections so far
        self.incoming: asyncio.Queue[Incoming] = asyncio.Queue()
        self.notices: list[Notice] = []
        self.connection = BrokerConnection(
            how,
            self.outbox,
            command_filter=self.topics.command_filter,
            will=self.publisher.will,
            on_incoming=self.incoming.put_nowait,
            on_notice=self.notices.append,
            on_link=self._note_link,
            pulse=self._fresh,
            on_version=self.versions.append,
        )
        self.publisher.wake_with(self.connection.wake)
        self.task: asyncio.Task[None] | None = None

    async def __aenter__(self) -> MqttRig:
        self.task = asyncio.create_task(self.connection.run())
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.vanish()

    async def vanish(self) -> None:
        """End as a killed process does: the socket closes, nothing more is said."""
        assert self.task is not None
        self.task.cancel()
        await asyncio.wait([self.task])

    async def link(self) -> tuple[bool, str]:
        """Return the next change of the link."""
        async with asyncio.timeout(PATIENCE_S):
            return await self.links.get()

    async def until_connected(self) -> None:
        while not (await self.link())[0]:
            pass

    async def until_idle(self) -> None:
        """Wait until the broker has acknowledged everything."""
        await self.connection._wait_until(lambda: self.outbox.is_idle, PATIENCE_S)
        assert self.outbox.is_idle

    def _fresh(self) -> Message:
        clock = SystemClock()
        return self.payloads.fresh(self.tokens.issue(clock.now_s()), clock.utc_s())

    def _note_link(self, is_connected: bool, trouble: str) -> None:
        if is_connected:
            self.boot.connected(SystemClock().now_s())
        else:
            self.boot.disconnected()
        self.links.put_nowait((is_connected, trouble))

    async def verdict(self) -> str:
        """Return what becomes of the next command by its freshness: `fresh`, or why it is refused."""
        incoming = await self.command()
        clock = SystemClock()
        judged = self.intake.judge(incoming, Moment(clock.now_s(), clock.utc_s()))
        return judged.code if isinstance(judged, Rejection) else "fresh"

    async def command(self) -> Incoming:
        """Return the next message on a command topic."""
        async with asyncio.timeout(PATIENCE_S):
            return await self.incoming.get()


def value(seq: int, number: float, *, point: str = "current") -> ValueRecord:
    return ValueRecord("pump-1", point, number, "A", Quality.GOOD, 1_760_000_000.0 + seq, seq)


def event(seq: int) -> EventRecord:
    return EventRecord("pump-1", "started", Severity.INFO, f"event {seq}", 1_760_000_000.0 + seq, seq)
