"""The edge node's connection: from the number on the disk to the births, and back to an orderly death.

It shares nothing with the main connection: neither outbox nor session, and it never holds anything up.
Nothing waits for it; what cannot be sent is replaced by a new birth.
"""

from __future__ import annotations

import asyncio
import platform
import secrets
from collections.abc import Collection
from dataclasses import replace
from math import inf

from gateway import __version__
from gateway.contract import EventCode, ForgetRecord, Record, ResultRecord, Severity
from gateway.errors import BrokerError
from gateway.mqtt import (
    FIRST_RETRY_S,
    LAST_RETRY_S,
    STEADY_S,
    BrokerSettings,
    Incoming,
    Session,
    SessionParts,
    connected,
)
from gateway.plugins.interface import Gateway
from gateway.plugins.sparkplug.commands import CommandMapper
from gateway.plugins.sparkplug.host_commands import MOST_BYTES, HostCommands
from gateway.plugins.sparkplug.metrics import ID_PREFIX, MetricFact, facts_of
from gateway.plugins.sparkplug.node import EdgeNode
from gateway.plugins.sparkplug.numbers import BirthNumbers
from gateway.plugins.sparkplug.payload import FALSE
from gateway.plugins.sparkplug.primary_host import PrimaryHost
from gateway.plugins.sparkplug.settings import REBIRTH, SparkplugSettings
from gateway.system.rate_limits import Backoff, ChangeDetector
from gateway.system.supervised import is_set_within, until_first

AT_ONCE = 10  # messages written until the loop's other tasks run, and until the socket has taken them
FULL_LOOK_S = 0.02  # until a full socket is looked at again
FACTS_EVERY_S = 5.0
HOST_PATIENCE_S = 2.0  # then it is published that the primary host is missing
HOST_WITHIN_S = 10.0  # of several servers: so long the primary host is waited for at each
DEATH_WITHIN_S = 0.5
DEATH_TICKET = 1
_REBIRTH = REBIRTH.encode("ascii")
HOST_GONE = "the primary host application went offline"
PROPERTIES = {
    "Properties/Software": "starter-gateway",
    "Properties/Version": __version__,
    "Properties/Hardware Make": platform.machine(),
    "Properties/OS": platform.system(),
    "Properties/OS Version": platform.release(),
}


class SparkplugService:
    """Keeps one edge node connected; a `Plugin`. All calls on the app's loop."""

    def __init__(self, settings: SparkplugSettings, gateway: Gateway) -> None:
        self._settings = settings
        self._gateway = gateway
        self._clock = gateway.clock
        self._node = EdgeNode(settings, gateway.latest, properties=PROPERTIES, since_s=gateway.started_s)
        self._host_commands: HostCommands | None = None
        if settings.operator:
            mapper = CommandMapper(settings.operator, ttl_s=settings.table.ttl_s)
            self._host_commands = HostCommands(mapper, gateway, self._show_done)
        self._numbers = BirthNumbers(gateway)
        self._backoff = Backoff(FIRST_RETRY_S, LAST_RETRY_S, seed=secrets.randbits(32))
        self._server = 0
        self._host = PrimaryHost(settings.table.primary_host)
        self._replaced = asyncio.Event()
        self._wake = asyncio.Event()
        self._sleeping_until_s = -inf
        self._facts_due_s = -inf
        self._leaving = ""  # why this connection is to end
        self._said = ChangeDetector()

    def put(self, record: Record) -> None:
        """Have what is new published; returns at once."""
        now_s = self._clock.now_s()
        match record:
            case ForgetRecord():
                self._node.forget(record.starters, self._clock.utc_s())
            # The result of a command that came this way.
            case ResultRecord(client=self._settings.operator, id=str(id_)) if id_.startswith(ID_PREFIX):
                self._node.answer(record.starter, facts_of(record), now_s)
        self._node.look(now_s)
        self._hurry()

    def reconfigure(self, settings: SparkplugSettings) -> None:
        """Follow other starters and lines; by any other change this node ends, and its successor begins."""
        if settings == replace(self._settings, starters=settings.starters, lines=settings.lines):
            self._settings = settings
            self._node.follow(settings)
            self._node.look(self._clock.now_s())
            self._hurry()
        else:
            self._replaced.set()

    async def run(self) -> None:
        """Stay connected until cancelled or replaced; then die in order."""
        await until_first(self._stay_connected(), self._replaced.wait())

    async def _stay_connected(self) -> None:
        while True:
            await self._serve_once(await self._numbers.take())
            self._server = (self._server + 1) % len(self._settings.servers)
            await asyncio.sleep(self._backoff.next_s())

    async def _serve_once(self, number: int) -> None:
        """Connect and serve until the loss."""
        server = self._settings.servers[self._server]
        self._leaving = ""
        self._host.begin()
        death_acked: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        will = self._node.death(number, self._clock.utc_s())
        parts = SessionParts(will, self._on_incoming, on_ack=lambda *_: death_acked.set_result(None))
        link: Session | None = None
        try:
            link = await connected(server, parts)
            link.lost.add_done_callback(lambda _: self._wake.set())
            await self._subscribe(link, server)
            await self._serve(link, server, number)
            reason = self._leaving or link.lost.result()
            self._report(f"broker {server.address}: {reason}")
        except BrokerError as error:
            self._report(str(error))
        finally:
            if link is not None:
                await self._die(link, number, death_acked)
                link.abort()
            self._node.end()

    async def _subscribe(self, link: Session, server: BrokerSettings) -> None:
        """Subscribe to everything before any birth [tck-id-message-flow-edge-node-ncmd-subscribe]."""
        topics = [self._settings.topic("NCMD")]
        topics += [] if self._host_commands is None else [self._settings.topic("DCMD", "+")]
        refused = [topic for topic in topics if not await link.subscribe(topic)]
        state = self._host.topic
        if state is not None and not await link.subscribe(state, with_retained=True):
            refused.append(state)
        if refused:
            raise BrokerError(
                f"broker {server.address} refuses to let the Sparkplug node read {', '.join(refused)}",
                "let this user read it, in the broker's access list",
            )

    async def _serve(self, link: Session, server: BrokerSettings, number: int) -> None:
        """Publish what is due until the connection is lost, or is to end."""
        since_s = self._clock.now_s()
        try:
            while not link.lost.done() and not self._leaving:
                self._wake.clear()
                if self._host.is_online:
                    self._sleeping_until_s = self._write(link, server, number)
                else:
                    self._sleeping_until_s = self._look_for_host(since_s)
                pause_s = self._sleeping_until_s - self._clock.now_s()
                await is_set_within(self._wake, max(0.0, pause_s))
        finally:
            if self._clock.now_s() - since_s >= STEADY_S:
                self._backoff.reset()

    def _write(self, link: Session, server: BrokerSettings, number: int) -> float:
        """Write what is due, as far as the socket takes it; return until when nothing more is to be done."""
        now_s, was_born = self._clock.now_s(), self._node.is_born
        if now_s >= self._facts_due_s:
            self._facts_due_s = now_s + FACTS_EVERY_S
            self._node.note(self._gateway.mqtt.facts(), now_s)
        if not self._node.is_begun:
            self._node.look(now_s)
            self._node.begin(number)
        if not link.has_sent_all:
            return now_s + FULL_LOOK_S
        for _ in range(AT_ONCE):
            message = self._node.take(now_s=now_s, utc_s=self._clock.utc_s())
            if message is None:
                break
            if link.publish(0, message) is not None:
                text = f"broker {server.address} takes no message of {len(message.payload)} bytes"
                raise BrokerError(text, "raise its limit")
        if self._node.is_born and not was_born:
            self._report("")
        return min(self._node.due_s, self._facts_due_s)

    def _look_for_host(self, since_s: float) -> float:
        """Say that the primary host is missing; of several servers, go on to the next one."""
        now_s, is_only = self._clock.now_s(), len(self._settings.servers) == 1
        if not is_only and now_s >= since_s + HOST_WITHIN_S:
            self._leaving = f"the primary host {self._settings.table.primary_host} is not at this server"
            return now_s
        if now_s < since_s + HOST_PATIENCE_S:
            return since_s + HOST_PATIENCE_S
        self._report(f"waits for the primary host {self._settings.table.primary_host}")
        return inf if is_only else since_s + HOST_WITHIN_S

    async def _die(self, link: Session, number: int, acked: asyncio.Future[None]) -> None:
        """Publish NDEATH, then leave so that the will goes out too, where MQTT 5 allows to say that."""
        if link.lost.done() or self._node.born_utc_s is None:
            return
        link.publish(DEATH_TICKET, self._node.death(number, self._clock.utc_s()))
        await asyncio.wait((acked,), timeout=DEATH_WITHIN_S)  # this may be a cancelled task
        await link.disconnect(with_will=True)

    def _hurry(self) -> None:
        """Wake up if there is something to publish before what is waited for."""
        if self._node.due_s < self._sleeping_until_s:
            self._wake.set()

    def _on_incoming(self, incoming: Incoming) -> None:
        payload, starter = incoming.payload, self._settings.commanded_device(incoming.topic)
        if self._host_commands is not None and starter is not None:
            if starter in self._settings.starters:
                self._host_commands.take(starter, incoming, self._node.born_utc_s)
            else:
                self._host_commands.refuse_unknown(starter)
        elif len(payload) > MOST_BYTES:
            return  # neither a STATE nor a request for a rebirth
        elif incoming.topic == self._host.topic:
            self._leaving = HOST_GONE if self._host.take(payload) else self._leaving
            self._wake.set()
        elif incoming.topic == self._settings.topic("NCMD") and _REBIRTH in payload:
            self._node.take_command(payload, self._clock.now_s())
            self._hurry()

    def _show_done(self, starter: str, names: Collection[str]) -> None:
        """Show what was written as false again."""
        utc_s = self._clock.utc_s()
        self._node.answer(starter, [MetricFact(name, FALSE, utc_s) for name in names], self._clock.now_s())
        self._hurry()

    def _report(self, trouble: str) -> None:
        """Publish each change of what is wrong; empty: nothing."""
        if not self._said.is_new(trouble):
            return
        publish_event = self._gateway.publish_event
        if trouble:
            publish_event(EventCode.SPARKPLUG_AWAY, "trouble", severity=Severity.WARNING, trouble=trouble)
        else:
            node = f"{self._settings.table.group}/{self._settings.node}"
            publish_event(EventCode.SPARKPLUG_BORN, node=node)
