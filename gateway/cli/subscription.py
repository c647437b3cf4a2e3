"""A tool's subscription at a broker: one connection that comes back by itself."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable

from gateway.errors import BrokerError
from gateway.mqtt import BrokerSettings, Incoming, Message, Session, connected

AGAIN_S = 2.0  # between two attempts


class Subscription:
    """Filters whose messages, retained ones too, are handed on; `trouble` says why none come."""

    def __init__(
        self, settings: BrokerSettings, filters: Iterable[str], on_incoming: Callable[[Incoming], None]
    ) -> None:
        self.trouble = ""
        self._settings = settings
        self._filters = tuple(filters)
        self._on_incoming = on_incoming
        self._session: Session | None = None
        self._sent = 0

    async def connect(self) -> asyncio.Future[str]:
        """Connect and subscribe; the future is done when the connection is lost. BrokerError."""
        session, _ = await connected(self._settings, on_incoming=self._on_incoming)
        for topic in self._filters:
            if not await session.subscribe(topic, with_retained=True):
                session.abort()
                raise BrokerError(
                    f"broker {self._settings.address} does not let {topic} be read",
                    "log in with --username, or look at its access list",
                )
        self._session, self.trouble = session, ""
        return session.lost

    async def stay(self, lost: asyncio.Future[str] | None) -> None:
        """Connect again whenever the connection is lost, until cancelled; None: there is none yet."""
        while True:
            if lost is not None:
                await asyncio.wait([lost])
                self.trouble = f"the connection to {self._settings.address} is lost; trying again"
            await asyncio.sleep(AGAIN_S)
            try:
                lost = await self.connect()
            except BrokerError as error:
                self.trouble = str(error)

    def publish(self, message: Message) -> None:
        """Send a message; without a connection it is dropped."""
        if self._session is not None:
            self._sent += 1
            self._session.publish(self._sent, message)
