"""Keeps the gateway connected to its broker, however often either goes away."""

from __future__ import annotations

import asyncio
import secrets
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace

from gateway.contract import Event
from gateway.errors import BrokerError
from gateway.mqtt.commands import Incoming
from gateway.mqtt.connection.connect import FIRST_RETRY_S, LAST_RETRY_S, STEADY_S, connected
from gateway.mqtt.connection.link_news import LinkNews
from gateway.mqtt.connection.session import Session, SessionParts
from gateway.mqtt.connection.settings import BrokerSettings, Version
from gateway.mqtt.message import Message
from gateway.mqtt.outbox.outbox import Outbox
from gateway.starters import TOKEN_EVERY_S
from gateway.system.rate_limits import Backoff
from gateway.system.supervised import is_set_within, until_first

PULSE_RETRY_S = 0.1
FAREWELL_TICKET = 0  # the outbox counts from 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Hooks:
    """The functions that a connection calls; none of them may block.

    `will` makes the message that the broker publishes when the connection is lost. `on_incoming` takes each
    message below `command_filter`, `on_read` those that come because of `read`. `on_link` is called for each
    change: with the connection's version of MQTT (None: there is none), and what is wrong (also while
    connected, when commands cannot arrive).
    `on_notice` is called for losses that need an event of their own: once, until a connection has held again.
    `pulse` makes a message of QoS 0 that goes out before all others of a connection and then every
    TOKEN_EVERY_S; it is made when it is sent, and never waits.
    """

    will: Callable[[], Message]
    on_incoming: Callable[[Incoming], None]
    on_link: Callable[[Version | None, str], None]
    on_notice: Callable[[Event], None]
    on_read: Callable[[Incoming], None]
    pulse: Callable[[], Message]


class BrokerConnection:
    """The connection to one broker at a time. All calls belong on the loop that runs `run`.

    Topics that are read must lie outside `command_filter`, whose messages are commands.
    """

    def __init__(
        self, settings: BrokerSettings, outbox: Outbox, *, command_filter: str, hooks: Hooks
    ) -> None:
        self.settings = settings  # of the present broker
        self._outbox = outbox
        self._command_filter = command_filter
        self._hooks = hooks
        self._session: Session | None = None
        self._sending: asyncio.Handle | None = None
        self._beating: asyncio.TimerHandle | None = None
        self._closing = asyncio.Event()
        self._moved = asyncio.Event()
        self._acknowledged = asyncio.Event()
        self._begin()

    @property
    def trouble(self) -> str:
        """Return what is wrong with the connection; empty for nothing."""
        return self._news.link[1]

    async def run(self) -> None:
        """Stay connected until closed or cancelled; never raises for what a network or a broker does."""
        try:
            while True:
                await until_first(self._stay_connected(), self._moved.wait())
                self._moved.clear()
                self._begin()
        finally:
            if self._sending is not None:
                self._sending.cancel()

    async def move(self, settings: BrokerSettings, farewell: Message, *, within_s: float) -> None:
        """Publish the end at the present broker, then let `run` connect to another, or by another login."""
        await self.close(farewell, within_s=within_s)
        self.settings = settings
        self._moved.set()

    def wake(self) -> None:
        """Send what the outbox has, soon; costs nothing when called often."""
        if self._session is not None and self._sending is None:
            self._sending = asyncio.get_running_loop().call_soon(self._send)

    def unlisten(self, topic: str) -> None:
        """Stop taking messages of a topic of `read`."""
        if self._session is not None:
            self._session.unlisten(topic)

    def read(self, topic_filter: str, on_answer: Callable[[bool], None]) -> None:
        """Have what is stored on these topics, as retained, and what comes, on this connection alone.

        `on_answer` is called with whether the broker permits it, unless the connection is lost before that.
        """
        if self._session is not None:
            self._session.read(topic_filter, on_answer)

    def beat(self) -> None:
        """Send the pulse now, where there is a connection, or try again soon; it is made when it is sent.

        With each pulse a part of the history may follow, so that it does not crowd out what is live.
        """
        if self._beating is not None:
            self._beating.cancel()
        if self._session is None or self._is_outbox_shut:
            return
        pause_s = PULSE_RETRY_S
        if self._session.publish_now(self._hooks.pulse()):
            pause_s = TOKEN_EVERY_S
            self._outbox.grant_history()
            self.wake()
        self._beating = asyncio.get_running_loop().call_later(pause_s, self.beat)

    async def close(self, farewell: Message, *, within_s: float = 2.0) -> None:
        """Send what still waits, then `farewell`, then disconnect; at the latest after `within_s`.

        An unacknowledged farewell drops the connection, which publishes the will. Cancel `run` afterwards.
        """
        self._closing.set()
        session = self._session
        if session is None:
            return
        await self._wait_until(lambda: self._outbox.is_idle or session.lost.done(), within_s / 2)
        self._is_outbox_shut = True
        await self._wait_until(lambda: _has_room(session) or session.lost.done(), within_s / 4)
        if _has_room(session):
            session.publish(FAREWELL_TICKET, farewell)
            await self._wait_until(
                lambda: self._farewell_code is not None or session.lost.done(), within_s / 4
            )
        if self._farewell_code is not None:
            await session.disconnect()
        session.abort()
        self._session = None  # a message of it that is still on its way to us counts as early

    def _begin(self) -> None:
        """Begin with the present broker, of which nothing is known yet."""
        self._backoff = Backoff(FIRST_RETRY_S, LAST_RETRY_S, seed=secrets.randbits(32))
        self._news = LinkNews(self.settings.client_id, self._hooks.on_link, self._hooks.on_notice)
        self._is_outbox_shut = False
        self._farewell_code: int | None = None
        self._closing.clear()

    def _take(self, incoming: Incoming) -> None:
        """Pass a message on by its topic: as a command, or to who reads.

        It never waits for the answer to the subscription, which may be late or not come: it may be a stop.
        """
        if incoming.topic.startswith(self._command_filter[:-2]):
            self._hooks.on_incoming(replace(incoming, is_early=self._session is None))
        else:
            self._hooks.on_read(incoming)

    async def _stay_connected(self) -> None:
        """Connect, again and again, until closed; then only a move ends the wait."""
        while not self._closing.is_set():
            await self._serve_once()
            await is_set_within(self._closing, self._backoff.next_s())
        await self._moved.wait()

    async def _serve_once(self) -> None:
        """Connect and serve until the loss."""
        parts = SessionParts(
            self._hooks.will(), self._take, self._acked, lambda notice: self._lost(notice, "")
        )
        session: Session | None = None
        try:
            session = await connected(self.settings, parts)
            is_subscribed = await session.subscribe(self._command_filter)
            await self._serve(session, is_deaf=not is_subscribed)
        except BrokerError as error:
            self._report(None, str(error))
        finally:
            if session is not None:
                session.abort()

    async def _serve(self, session: Session, *, is_deaf: bool) -> None:
        holding = asyncio.get_running_loop().call_later(STEADY_S, self._held)
        reason = "ended by an error inside the gateway"
        self._session = session
        self._outbox.connected(session.window)
        try:
            deaf = (
                f"broker {self.settings.address} refuses commands: no subscription to {self._command_filter}"
            )
            hint = "let this user read it, in the broker's access list"
            self._report(session.version, str(BrokerError(deaf, hint)) if is_deaf else "")
            self.beat()
            self.wake()
            reason = await session.lost
        finally:
            self._session = None
            holding.cancel()
            if self._beating is not None:
                self._beating.cancel()
            self._outbox.disconnected()
            self._acknowledged.set()
            self._report(None, f"broker {self.settings.address}: {reason}")
        self._lost(session.notice, reason)

    def _held(self) -> None:
        """Count this connection as one that holds."""
        self._backoff.reset()
        self._news.held()

    def _report(self, version: Version | None, trouble: str) -> None:
        if not self._closing.is_set():
            self._news.report(version, trouble)

    def _lost(self, notice: Event | None, reason: str) -> None:
        if not self._closing.is_set():
            self._news.lost(notice, reason)

    def _send(self) -> None:
        self._sending = None
        while self._session is not None and not self._is_outbox_shut and not self._session.lost.done():
            outgoing = self._outbox.take()
            if outgoing is None:
                return
            refusal = self._session.publish(outgoing.ticket, outgoing.message)
            if refusal is not None:
                self._acked(outgoing.ticket, refusal)

    def _acked(self, ticket: int, reason_code: int) -> None:
        if ticket == FAREWELL_TICKET:
            self._farewell_code = reason_code
        else:
            self._outbox.acked(ticket, reason_code)
        self._acknowledged.set()
        session = self._session
        # A message for each acknowledgement, one by one, would wake us and the broker for each.
        if session is not None and session.in_flight <= session.window // 2:
            self.wake()

    async def _wait_until(self, is_true: Callable[[], bool], within_s: float) -> None:
        """Wait, for a limited time, for something that an acknowledgement or a loss may make true."""
        with suppress(TimeoutError):
            async with asyncio.timeout(within_s):
                while not is_true():
                    self._acknowledged.clear()
                    await self._acknowledged.wait()


def _has_room(session: Session) -> bool:
    return session.in_flight < session.window
