"""The edge node's connection: from the number on the disk to the births, and back to an orderly death.

It shares nothing with the main connection: neither outbox nor session, and it never holds anything up.
Nothing waits for it; what cannot be sent is replaced by a new birth.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Collection, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from math import inf

from gateway.contract import EventCode, PublishEvent, Record, Severity
from gateway.errors import BrokerError, DamagedError, StoreError
from gateway.mqtt.commands import Incoming
from gateway.mqtt.connection.reconnect import Version, VersionChoice
from gateway.mqtt.connection.session import Session, SessionParts
from gateway.mqtt.connection.settings import BrokerSettings
from gateway.plugins.sparkplug.commands import CommandMapper
from gateway.plugins.sparkplug.host_commands import MOST_BYTES, HostCommands
from gateway.plugins.sparkplug.metrics import NodeMetrics
from gateway.plugins.sparkplug.node import SEQ_NUMBERS, EdgeNode
from gateway.plugins.sparkplug.payload import Value, decoded_command
from gateway.plugins.sparkplug.primary_host import PrimaryHost
from gateway.plugins.sparkplug.settings import SparkplugSettings
from gateway.plugins.sparkplug.topics import REBIRTH, EdgeTopics
from gateway.starters.commands.submit import Commands
from gateway.starters.policy.rights import Rights
from gateway.storage.json_file import JsonStore
from gateway.system.clock import Clock
from gateway.system.rate_limits import Backoff, Bucket, ChangeDetector, Rate
from gateway.system.supervised import InThread

log = logging.getLogger(__name__)

AT_ONCE = 10  # messages written until the loop's other tasks run, and until the socket has taken them
FULL_LOOK_S = 0.02  # how soon a socket that takes no more is looked at again
FACTS_EVERY_S = 5.0
HOST_PATIENCE_S = 2.0  # then it is published that the primary host is missing
HOST_WITHIN_S = 10.0  # of several servers: so long the primary host is waited for at each
DEATH_WITHIN_S = 0.5
DEATH_TICKET = 1
_REBIRTH = REBIRTH.encode("ascii")
NODE_COMMANDS = Rate(5.0, 10)  # a second, at once: decoding takes time of the loop that carries out the stops
HOST_GONE = "the primary host application went offline"

MakeLink = Callable[[BrokerSettings, Version, SessionParts], Session]  # not yet connected


class BdSequence:
    """The numbers of births and deaths, each on the disk before its CONNECT."""

    def __init__(self, store: JsonStore, in_thread: InThread) -> None:
        self._store = store
        self._in_thread = in_thread
        self._last: int | None = None  # None: not yet read

    async def take(self) -> tuple[int, str]:
        """Return the number of the next connection, and what is wrong with its storage, if anything."""
        if self._last is None:
            self._last = await self._in_thread(self._read)
        self._last = (self._last + 1) % SEQ_NUMBERS
        try:
            await self._store.save({"bdSeq": self._last})
        except StoreError as error:
            return self._last, str(error)
        return self._last, ""

    def _read(self) -> int:
        try:
            document = self._store.load() or {}
        except DamagedError as error:
            log.warning("%s; births are counted from 0 again", error)
            self._store.set_aside()
            document = {}
        last = document.get("bdSeq")
        return last if isinstance(last, int) and 0 <= last < SEQ_NUMBERS else SEQ_NUMBERS - 1


@dataclass(frozen=True, slots=True)
class SparkplugParts:
    """What the gateway gives its edge node: the past, the time, and the ways in."""

    latest: Callable[[], Iterable[Record]]  # the newest records of before
    clock: Clock
    commands: Commands
    facts: Callable[[], Mapping[str, Value]]  # what the gateway says of itself
    publish_event: PublishEvent
    since_s: float  # UTC: when this run of the gateway began


class SparkplugLink:
    """Keeps one edge node connected. All calls on the loop that runs `run`."""

    def __init__(
        self,
        settings: SparkplugSettings,
        node: EdgeNode,
        parts: SparkplugParts,
        *,
        mapper: CommandMapper | None,
        store: JsonStore,
        make_link: MakeLink,
        in_thread: InThread,
    ) -> None:
        self._settings = settings
        self._node = node
        self._parts = parts
        self._host_commands = None if mapper is None else self._commands_of(mapper)
        self._node_commands = Bucket(NODE_COMMANDS)
        self._numbers = BdSequence(store, in_thread)
        self._clock = parts.clock
        self._make_link = make_link
        self._choices = [VersionChoice(each.version) for each in settings.servers]
        self._backoff = Backoff(
            settings.servers[0].first_retry_s, settings.servers[0].last_retry_s, seed=settings.servers[0].seed
        )
        self._server = 0
        self._host = PrimaryHost(settings.primary_host)
        self._wake = asyncio.Event()
        self._sleeping_until_s = -inf
        self._facts_due_s = -inf
        self._host_due_s = inf  # when something is done about a primary host that is not there
        self._leaving = ""  # why this connection is to end
        self._death_acked = asyncio.Event()
        self._said = ChangeDetector()
        self._storage_trouble = ""

    def put(self, record: Record) -> None:
        """Take a record, in order; returns at once."""
        self._node.put(record, now_s=self._clock.now_s(), utc_s=self._clock.utc_s())
        self._hurry()

    def follow(self, starters: tuple[str, ...], lines: tuple[str, ...]) -> None:
        """Have these starters and lines from now on."""
        self._node.move(starters)
        self._node.move_lines(lines)
        self._hurry()

    async def run(self) -> None:
        """Stay connected until cancelled; then die in order."""
        while True:
            number, trouble = await self._numbers.take()
            self._note_storage(trouble)
            if not await self._serve_once(number):
                self._server = (self._server + 1) % len(self._settings.servers)
                await asyncio.sleep(self._backoff.next_s())

    async def _serve_once(self, number: int) -> bool:
        """Connect and serve until the loss; return whether to connect again at once."""
        server, choice = self._settings.servers[self._server], self._choices[self._server]
        self._leaving = ""
        self._death_acked.clear()
        self._host.begin()
        link = self._make_link(
            server,
            choice.version,
            SessionParts(
                will=self._node.death(number, self._clock.utc_s()),
                on_incoming=self._on_incoming,
                on_ack=lambda *_: self._death_acked.set(),
            ),
        )
        try:
            await link.connect()
            await self._subscribe(link, server)
            await self._serve(link, server, number)
        except BrokerError as error:
            if choice.failed(link.connack_code, is_closed=link.is_closed_unanswered):
                return True
            choice.begin()
            self._report(str(error))
        except asyncio.CancelledError:
            await self._die(link, number)
            raise
        finally:
            self._node.end()
            link.abort()
        return False

    async def _subscribe(self, link: Session, server: BrokerSettings) -> None:
        """Subscribe to everything before any birth [tck-id-message-flow-edge-node-ncmd-subscribe]."""
        topics = [self._node.topics.node_command]
        topics += [] if self._host_commands is None else [self._node.topics.device_commands]
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
        since_s = self._clock.now_s()
        self._node.permit(is_permitted=self._host.is_online)
        self._node.begin(number)
        try:
            while not link.lost.done() and not self._leaving:
                self._note_facts()
                self._look_for_host(since_s)
                await self._sleep(link, self._write(link, server))
        finally:
            if self._clock.now_s() - since_s >= server.steady_s:
                self._backoff.reset()
        if self._leaving:
            await self._die(link, number)
        reason = self._leaving or link.lost.result()
        self._report(f"broker {server.address}: {reason}")

    def _write(self, link: Session, server: BrokerSettings) -> float:
        """Write what is due, as far as the socket takes it; return until when nothing more is to be done."""
        now_s = self._clock.now_s()
        if not link.has_sent_all:
            return now_s + FULL_LOOK_S
        was_born = self._node.is_born
        for _ in range(AT_ONCE):
            message = self._node.take(now_s=now_s, utc_s=self._clock.utc_s())
            if message is None:
                break
            if link.publish(0, message) is not None:
                text = f"broker {server.address} takes no message of {len(message.payload)} bytes"
                raise BrokerError(text, "raise its limit")
        if self._node.is_born and not was_born:
            self._report("")
        return min(self._node.due_s, self._facts_due_s, self._host_due_s)

    async def _sleep(self, link: Session, until_s: float) -> None:
        """Wait until that time, for a loss, or for what is due before."""
        self._sleeping_until_s = until_s
        pause_s = until_s - self._clock.now_s()
        if pause_s <= 0:
            await asyncio.sleep(0)
            return
        self._wake.clear()
        link.lost.add_done_callback(self._wake_up)
        with suppress(TimeoutError):
            async with asyncio.timeout(None if pause_s == inf else pause_s):
                await self._wake.wait()
        link.lost.remove_done_callback(self._wake_up)

    def _wake_up(self, _: object) -> None:
        self._wake.set()

    def _hurry(self) -> None:
        """Wake up if there is something to do before what is waited for."""
        if self._node.due_s < self._sleeping_until_s:
            self._wake.set()

    async def _die(self, link: Session, number: int) -> None:
        """Publish NDEATH, then leave so that the will goes out too, where MQTT 5 allows to say that."""
        if link.lost.done() or self._node.born_utc_s is None:
            return
        self._death_acked.clear()
        link.publish(DEATH_TICKET, self._node.death(number, self._clock.utc_s()))
        acked = asyncio.create_task(self._death_acked.wait())
        await asyncio.wait(
            (acked,), timeout=DEATH_WITHIN_S
        )  # no asyncio.timeout: this may be a cancelled task
        acked.cancel()
        await link.disconnect(with_will=True)

    def _look_for_host(self, since_s: float) -> None:
        """Say that the primary host is missing; of several servers, go on to the next one."""
        self._host_due_s = inf
        if self._host.is_online:
            return
        now_s, is_only = self._clock.now_s(), len(self._settings.servers) == 1
        if not is_only and now_s >= since_s + HOST_WITHIN_S:
            self._leaving = f"the primary host {self._settings.primary_host} is not at this server"
        elif now_s >= since_s + HOST_PATIENCE_S:
            self._report(f"waits for the primary host {self._settings.primary_host}")
            self._host_due_s = inf if is_only else since_s + HOST_WITHIN_S
        else:
            self._host_due_s = since_s + HOST_PATIENCE_S

    def _note_facts(self) -> None:
        now_s = self._clock.now_s()
        if now_s >= self._facts_due_s:
            self._facts_due_s = now_s + FACTS_EVERY_S
            self._node.note(self._parts.facts(), now_s=now_s, utc_s=self._clock.utc_s())

    def _on_incoming(self, incoming: Incoming) -> None:
        try:
            self._on_message(incoming)
        except Exception:  # one message's guard: the next one may be a stop
            log.exception("topic=%s not taken because of a bug", incoming.topic[:200])
        self._hurry()

    def _on_message(self, incoming: Incoming) -> None:
        topics, payload = self._node.topics, incoming.payload
        starter = topics.commanded_device(incoming.topic)
        if self._host_commands is not None and starter is not None:
            if self._node.has(starter):
                self._host_commands.take(starter, incoming, self._node.born_utc_s)
            else:
                self._host_commands.refuse_unknown(starter)
        elif len(payload) > MOST_BYTES:
            return  # neither a STATE nor a request for a rebirth
        elif incoming.topic == self._host.topic:
            self._on_host(payload)
        elif incoming.topic == topics.node_command and _REBIRTH in payload:
            self._on_node_command(payload)

    def _on_node_command(self, payload: bytes) -> None:
        """Honour a request for a rebirth; of a flood only some are looked into."""
        now_s = self._clock.now_s()
        if self._node_commands.take(now_s):
            command = decoded_command(payload)
            if command.is_asking(REBIRTH) and not command.is_broken:
                self._node.request_rebirth(now_s)

    def _on_host(self, payload: bytes) -> None:
        if self._host.take(payload):
            self._leaving = HOST_GONE
        else:
            self._node.permit(is_permitted=self._host.is_online)
        self._wake.set()

    def _commands_of(self, mapper: CommandMapper) -> HostCommands:
        parts = self._parts
        return HostCommands(
            mapper,
            clock=parts.clock,
            commands=parts.commands,
            publish_event=parts.publish_event,
            show_done=self._show_done,
        )

    def _show_done(self, starter: str, names: Collection[str]) -> None:
        """Show what was written as false again."""
        now_s, utc_s = self._clock.now_s(), self._clock.utc_s()
        for name in names:
            self._node.command_done(starter, name, now_s=now_s, utc_s=utc_s)
        self._hurry()

    def _report(self, trouble: str) -> None:
        """Publish each change of what is wrong; empty: nothing."""
        if not self._said.is_new(trouble):
            return
        if trouble:
            log.warning("sparkplug: %s", trouble)
            self._parts.publish_event(
                EventCode.SPARKPLUG_AWAY, "trouble", severity=Severity.WARNING, trouble=trouble
            )
        else:
            node = f"{self._settings.group}/{self._settings.node}"
            log.info("sparkplug: node=%s born", node)
            self._parts.publish_event(EventCode.SPARKPLUG_BORN, node=node)

    def _note_storage(self, trouble: str) -> None:
        if trouble and not self._storage_trouble:
            self._parts.publish_event(
                EventCode.MEMORY_AWAY, "sparkplug", severity=Severity.WARNING, trouble=trouble
            )
        self._storage_trouble = trouble


def sparkplug_link(
    settings: SparkplugSettings,
    parts: SparkplugParts,
    *,
    starters: tuple[str, ...],
    lines: tuple[str, ...],
    properties: Mapping[str, str],
    store: JsonStore,
    make_link: MakeLink = Session,
    in_thread: InThread = asyncio.to_thread,
) -> SparkplugLink:
    """Return an edge node that knows what was recorded before."""
    node = EdgeNode(
        EdgeTopics(settings.group, settings.node),
        NodeMetrics(properties, lines, parts.facts()),
        starters,
        since_s=parts.since_s,
        operator=settings.operator,
        rights=Rights(settings.rights),
        has_datatypes=settings.has_datatypes,
    )
    now_s, utc_s = parts.clock.now_s(), parts.clock.utc_s()
    for record in parts.latest():
        node.put(record, now_s=now_s, utc_s=utc_s)
    mapper = CommandMapper(settings.operator, ttl_s=settings.ttl_s) if settings.operator else None
    return SparkplugLink(
        settings, node, parts, mapper=mapper, store=store, make_link=make_link, in_thread=in_thread
    )
