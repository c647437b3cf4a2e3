"""The MQTT floor put together as the application does it, with everything it hears written down."""

from __future__ import annotations

import asyncio
from types import TracebackType

from gateway.clock import SystemClock
from gateway.mqtt.broker import BrokerConnection
from gateway.mqtt.intake import Incoming
from gateway.mqtt.outbox import Outbox
from gateway.mqtt.payload import Payloads
from gateway.mqtt.publisher import Publisher
from gateway.mqtt.reasons import Notice
from gateway.mqtt.settings import BrokerSettings
from gateway.mqtt.topics import Topics
from gateway.starters.records import EventRecord, Quality, Severity, ValueRecord

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


class Rig:
    """A gateway that is nothing but its MQTT floor."""

    def __init__(self, how: BrokerSettings) -> None:
        self.topics = Topics("b")
        self.payloads = Payloads(self.topics, "boot-1")
        self.outbox = Outbox(last_topic=self.topics.gateway_status, pack=self.payloads.history, boot="boot-1")
        self.outbox.grant_history(10**6)  # nobody paces what is told late
        self.publisher = Publisher(self.payloads, self.outbox, SystemClock())
        self.links: asyncio.Queue[tuple[bool, str]] = asyncio.Queue()
        self.incoming: asyncio.Queue[Incoming] = asyncio.Queue()
        self.notices: list[Notice] = []
        self.connection = BrokerConnection(
            how,
            self.outbox,
            command_filter=self.topics.command_filter,
            will=self.publisher.will,
            on_incoming=self.incoming.put_nowait,
            on_link=lambda is_connected, trouble: self.links.put_nowait((is_connected, trouble)),
            on_notice=self.notices.append,
        )
        self.publisher.wake_with(self.connection.wake)
        self.task: asyncio.Task[None] | None = None

    async def __aenter__(self) -> Rig:
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

    async def command(self) -> Incoming:
        """Return the next message on a command topic."""
        async with asyncio.timeout(PATIENCE_S):
            return await self.incoming.get()


def value(seq: int, number: float, *, point: str = "current") -> ValueRecord:
    return ValueRecord("pump-1", point, number, "A", Quality.GOOD, 1_760_000_000.0 + seq, seq)


def event(seq: int) -> EventRecord:
    return EventRecord("pump-1", "started", Severity.INFO, f"event {seq}", 1_760_000_000.0 + seq, seq)
