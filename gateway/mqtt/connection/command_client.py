"""Sends one command as an operator does, and follows it to its end; no part of the running gateway."""

from __future__ import annotations

import asyncio
import uuid
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager
from dataclasses import replace
from typing import TypeVar

from gateway.contract import (
    STOP,
    CommandRequest,
    FreshRecord,
    Record,
    ResultRecord,
    StatusRecord,
    Topics,
    encoded,
    read_record,
    rfc3339,
)
from gateway.errors import BrokerError, GatewayError, NoResultError
from gateway.mqtt.commands import Incoming
from gateway.mqtt.connection.connect import connected
from gateway.mqtt.connection.session import Session, SessionParts
from gateway.mqtt.connection.settings import BrokerSettings
from gateway.mqtt.message import FIRST_FAILURE, Message

STATUS_WITHIN_S = 5.0  # the retained status comes with the subscription
STOP_STATUS_WITHIN_S = 0.25  # a stop does not wait for it
TROUBLED_WITHIN_S = 2.0  # for the result of a stop that was sent although no gateway seemed to be there
SAID = ("id", "args", "ttl_s", "operator", "reason", "expect", "select")  # by who gives the command

R = TypeVar("R", bound=Record)


class CommandClient:
    """One command, once."""

    def __init__(self, settings: BrokerSettings, topics: Topics) -> None:
        self._settings = settings
        self._topics = topics
        self._news: asyncio.Queue[Incoming | int | None] = asyncio.Queue()  # int: reason code; None: lost

    async def send(
        self,
        order: CommandRequest,
        *,
        now_s: float,
        within_s: float,
        on_phase: Callable[[ResultRecord], None],
    ) -> ResultRecord:
        """Return the final result; every phase goes to `on_phase` before. `now_s` is the wall time.

        BrokerError when the broker or the gateway is away, or writing is forbidden: it was not sent.
        NoResultError when it was sent, and its end is unknown.
        """
        order = replace(order, id=order.id or uuid.uuid4().hex)
        is_stop = order.verb == STOP
        proof: Mapping[str, str] = {}
        trouble: BrokerError | None = None
        async with self._connected() as session:
            results = self._topics.of(ResultRecord, starter=order.starter, client=order.client)
            if not await session.subscribe(results):
                trouble = self._forbidden(f"read the results of {order.client}")
            try:
                proof = await self._proof(session, is_stop=is_stop)
            except BrokerError as error:
                trouble = trouble or error
            # A stop is sent without any proof; what would have prevented it is reported if no result comes.
            if trouble is not None and (not is_stop or session.lost.done()):
                raise trouble
            session.publish(1, self._message(order, proof=proof, now_s=now_s))
            within_s = min(within_s, TROUBLED_WITHIN_S) if trouble is not None else within_s
            try:
                async with asyncio.timeout(within_s):
                    return await self._final(order, on_phase)
            except TimeoutError:
                if trouble is not None:
                    raise BrokerError(f"the stop was sent, and no gateway answered: {trouble}") from None
                text = f"no final result within {within_s:g} s: look at the starter before you try again"
                hint = f"is {order.client} allowed to write commands?"
                raise NoResultError(str(order.id), f"{text} ({hint})") from None

    async def retained(self, kind: type[R], *, within_s: float, **names: str) -> R | None:
        """Return the retained record of a topic, None when there is none; BrokerError as `send`."""
        async with self._connected() as session:
            return await self._retained(session, within_s, kind, **names)

    @asynccontextmanager
    async def _connected(self) -> AsyncIterator[Session]:
        parts = SessionParts(
            on_incoming=self._news.put_nowait, on_ack=lambda _, code: self._news.put_nowait(code)
        )
        session = await connected(self._settings, parts)
        session.lost.add_done_callback(lambda _: self._news.put_nowait(None))
        try:
            yield session
        finally:
            await session.disconnect()

    async def _proof(self, session: Session, *, is_stop: bool) -> Mapping[str, str]:
        """Return what proves a command fresh; BrokerError where no gateway gives it."""
        within_s = STOP_STATUS_WITHIN_S if is_stop else STATUS_WITHIN_S
        status = await self._retained(session, within_s, StatusRecord)
        if status is None:
            raise self._missing(StatusRecord, "state", "is it running?")
        if status.state == "offline":
            raise BrokerError(f"the gateway is offline: {status.reason or 'no reason given'}", "start it")
        if is_stop:
            return {"boot": status.boot}
        # Taken last, so that it is as young as can be.
        fresh = await self._retained(session, within_s, FreshRecord)
        if fresh is None:
            raise self._missing(FreshRecord, "token", "is it of this version?")
        return {"boot": status.boot, "token": fresh.token}

    async def _retained(self, session: Session, within_s: float, kind: type[R], **names: str) -> R | None:
        topic = self._topics.of(kind, **names)
        if not await session.subscribe(topic, with_retained=True):
            raise self._forbidden(f"read {topic}")
        try:
            async with asyncio.timeout(within_s):
                while True:
                    record = await self._next(kind, names)
                    if record is not None:
                        return record
        except TimeoutError:
            return None

    async def _final(self, order: CommandRequest, on_phase: Callable[[ResultRecord], None]) -> ResultRecord:
        names = {"starter": order.starter, "client": order.client}
        while True:
            result = await self._next(ResultRecord, names, order)
            if result is not None and result.id == order.id:
                if result.phase.is_final:
                    return result
                on_phase(result)

    async def _next(
        self, kind: type[R], names: Mapping[str, str], order: CommandRequest | None = None
    ) -> R | None:
        """Return the next message when it is such a record and readable, else None."""
        news = await self._news.get()
        match news:
            case None:
                raise self._lost(order)
            case int() if news >= FIRST_FAILURE and order is not None:
                raise self._forbidden(
                    f"write {self._topics.command(order.starter, order.client, order.verb)}"
                )
            case Incoming() if news.topic == self._topics.of(kind, **names):
                try:
                    return read_record(kind, news.payload, **names)
                except ValueError:
                    return None
            case _:
                return None

    def _message(self, order: CommandRequest, *, proof: Mapping[str, str], now_s: float) -> Message:
        said = {name: getattr(order, name) for name in SAID}
        body = {**said, "issued_at": rfc3339(now_s), **proof}
        topic = self._topics.command(order.starter, order.client, order.verb)
        payload = encoded({name: value for name, value in body.items() if value})
        return Message(topic, payload, qos=1, retain=False)

    def _missing(self, kind: type[Record], name: str, hint: str) -> BrokerError:
        return BrokerError(f"no gateway has published its {name} in {self._topics.of(kind)}", hint)

    def _lost(self, order: CommandRequest | None) -> GatewayError:
        text = f"the connection to {self._settings.address} was lost"
        if order is None:
            return BrokerError(text, "nothing was sent")
        return NoResultError(str(order.id), f"{text} before the final result: look at the starter")

    def _forbidden(self, what: str) -> BrokerError:
        who = f"user {self._settings.username}" if self._settings.username else "a client without login"
        hint = "log in as the operator with --username, or look at its access list"
        return BrokerError(f"broker {self._settings.address} does not let {who} {what}", hint)
