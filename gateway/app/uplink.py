"""The uplink: the outbox, the publisher and the connection to the broker.

The connection can be moved to another broker, or another login, while everything else continues. The run
token (`boot`) follows the connection: the token of a lost one proves nothing any more.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from typing import Any

from gateway import __version__
from gateway.app.site import Site
from gateway.config import Config, broker_of, policy_of, rights_of
from gateway.contract import (
    EventCode,
    FreshRecord,
    GatewayRecord,
    PublishEvent,
    Record,
    ResultRecord,
    Sink,
    StatusRecord,
    Topics,
)
from gateway.mqtt import (
    BrokerConnection,
    BrokerSettings,
    DiskSync,
    Hooks,
    Incoming,
    Leftovers,
    Message,
    Outbox,
    Publisher,
    Version,
    message_of,
)
from gateway.starters import Tokens
from gateway.store import OutboxTable, Store, Work
from gateway.system.clock import Clock
from gateway.system.rate_limits import Damped

log = logging.getLogger(__name__)

FAREWELL_S = 3.0
RENEWED_EVERY_S = 0.05  # tokens of a flood of stops; shorter than any stop takes to be confirmed
STORE_WITHIN_S = 1.0
MOVED = "the configuration names another broker or another login"


class Uplink:
    """Speaks MQTT below one base; all calls on the app's loop."""

    def __init__(
        self,
        site: Site,
        tokens: Tokens,
        *,
        store: Store,
        clock: Clock,
        sink: Sink,
        publish_event: PublishEvent,
    ) -> None:
        self._sink = sink
        self._on_link: Callable[[str | None], None]
        self._listeners: dict[str, Callable[[bytes], None]] = {}  # by topic
        self._connection: BrokerConnection
        self.topics = Topics(site.config.base)
        self._tokens = tokens
        self._clock = clock
        self._publish_event = publish_event
        self._version: Version | None = None
        self.outbox = Outbox(last_topic=self.topics.of(StatusRecord), boot=tokens.run, utc_of=clock.utc_s)
        self.publisher = Publisher(self.topics, tokens, self.outbox, sink=sink, clock=clock)
        self.disk_sync = DiskSync(
            self.outbox,
            store,
            OutboxTable(),
            clock=clock,
            publish_event=publish_event,
            wake=lambda: self.publisher.wake(),
        )
        self._config = site.config
        self.leftovers = Leftovers(
            self.topics,
            tokens,
            is_current=self._is_configured,
            is_published=self.outbox.has,
            clear=self.publisher.clear,
            publish_event=publish_event,
            on_read=lambda: self._on_link(self._connection.trouble),
        )
        self.reconfigure(site.config)
        self._renewal: Damped[None] = Damped(
            lambda *_: self._connection.beat(), clock=clock, every_s=RENEWED_EVERY_S
        )

    def connect(
        self,
        site: Site,
        *,
        on_incoming: Callable[[Incoming], None],
        on_link: Callable[[str | None], None],
    ) -> None:
        """Make the connection, which `run` opens; once, before anything else is called.

        `on_incoming` gets every message on a command topic, `on_link` what is wrong with the connection at
        every change of it: empty for nothing, None while what earlier runs left retained is being read.
        """
        self._on_link = on_link
        self._connection = BrokerConnection(
            settings_of(site),
            self.outbox,
            command_filter=self.topics.command_filter,
            hooks=Hooks(
                will=self.publisher.will,
                on_incoming=on_incoming,
                on_link=self._note_link,
                on_notice=self._publish_event,
                on_read=self._take,
                pulse=self._fresh,
            ),
        )
        self.publisher.wake = self._connection.wake

    def listen(self, topic: str, on_message: Callable[[bytes], None]) -> None:
        """Have the live payloads of one more topic, at any broker; none of them is ever a command."""
        if topic.startswith(self.topics.command_filter.removesuffix("#")):
            raise ValueError(f"{topic} is a topic of commands")
        self._listeners[topic] = on_message
        self._read(topic)

    def unlisten(self, topic: str) -> None:
        """Stop taking messages of a topic of `listen`."""
        self._listeners.pop(topic, None)
        self._connection.unlisten(topic)

    def reconfigure(self, config: Config) -> None:
        """Publish what this gateway is by another configuration; `move` follows its broker."""
        self._config = config
        self._sink.put(
            GatewayRecord(
                version=__version__,
                boot=self._tokens.run,
                starters=tuple(starter.name for starter in config.starters),
                lines=tuple(line.name for line in config.lines),
                operators=rights_of(config).operators,
                groups=policy_of(config).groups,
                mqtt_version=self._version,
                line_titles={line.name: line.title for line in config.lines if line.title},
                group_titles={group.name: group.title for group in config.groups if group.title},
            )
        )

    def announce(self, message: Message) -> None:
        """Publish a message of a plugin, on a topic that is none of the gateway's own."""
        self.publisher.announce(message)

    def retained(self, topic: str) -> Message | None:
        """Return the newest message of a retained topic; None once the broker has been made to forget it."""
        return self.outbox.retained(topic)

    def is_connected(self) -> bool:
        """Return whether messages go out now."""
        return self.outbox.is_connected

    def statistics(self) -> dict[str, Any]:
        """Return what waits for the broker."""
        return self.outbox.statistics(self._clock.now_s())

    def facts(self) -> dict[str, Any]:
        """Return what a plugin says of the gateway itself."""
        statistics = self.statistics()
        return {
            "gateway/status": self.publisher.state,
            "broker/connected": self.outbox.is_connected,
            "outbox/depth": statistics["depth"],
            "outbox/oldest_s": float(statistics["oldest_s"]),
            "outbox/dropped": statistics["dropped"],
        }

    def renew_token(self) -> None:
        """Publish a new token now: a stop has come, and who starts after it must have read one since."""
        self._renewal.put("", None)

    def restate(self) -> None:
        """Publish the present boot and a new token: the earlier ones do not count any more."""
        self.publisher.restate()
        self._connection.beat()

    async def run(self) -> None:
        """Stay connected to the broker that the latest configuration names."""
        await self._connection.run()

    async def move(self, site: Site) -> None:
        """Publish the end here, then connect as this site demands, if that differs from now."""
        settings = settings_of(site)
        if settings == self._connection.settings:
            return
        await self._connection.move(settings, self.publisher.farewell(MOVED), within_s=FAREWELL_S)
        self._note_link(None, f"moving to broker {settings.address}: {MOVED}")

    def stage(self, result: ResultRecord) -> Work | None:
        """Return what stores a final result for the broker, in the transaction of its command.

        None for a result that is no final one, or has no id.
        """
        return self.disk_sync.stage(message_of(result, self.topics.base)) if result.key else None

    def keep(self, record: Record) -> Future[None]:
        """Store a record that has a key for the broker; it is sent once it was put on the bus."""
        return self.disk_sync.keep(message_of(record, self.topics.base))

    async def close(self, reason: str) -> None:
        """Publish what waits, and that the gateway is offline."""
        await self._connection.close(self.publisher.farewell(reason), within_s=FAREWELL_S)

    async def end(self) -> None:
        """Store what could not be published, for the next run; after `close`."""
        await self.disk_sync.close(within_s=STORE_WITHIN_S)

    def _note_link(self, version: Version | None, trouble: str) -> None:
        """Publish that the connection came or went; its run token comes and goes with it."""
        if version is not None:
            self._note_version(version)
            self._tokens.connected(self._clock.now_s())
            self._publish_event(EventCode.BROKER_CONNECTED)
            self.leftovers.connected(self._connection)
            for topic in self._listeners:
                self._read(topic)
        else:
            self.leftovers.disconnected()
            self._tokens.disconnected()
            self.publisher.restate()  # with the run token of the next connection
            self._publish_event(EventCode.BROKER_AWAY, trouble=trouble)
        self._on_link(trouble if trouble or self.leftovers.is_read else None)

    def _read(self, topic: str) -> None:
        def note(is_permitted: bool) -> None:  # noqa: FBT001 - the callback's shape
            if not is_permitted:
                log.warning("broker refuses a subscription to %s: let this user read it", topic)

        self._connection.read(topic, note)

    def _take(self, incoming: Incoming) -> None:
        """Pass on what comes on a topic that is read; what the broker has stored is for `leftovers` alone."""
        on_message = self._listeners.get(incoming.topic)
        if on_message is None:
            self.leftovers.take(incoming)
        elif not incoming.is_retained:
            on_message(incoming.payload)

    def _is_configured(self, names: Mapping[str, str]) -> bool:
        """Return whether the starter or line that a topic names is in the present configuration."""
        line = names.get("line")
        tables = self._config.starters if line is None else self._config.lines
        return any(table.name == (line or names["starter"]) for table in tables)

    def _fresh(self) -> Message:
        """Return the proof of freshness of this moment, for the live connection only."""
        fresh = FreshRecord(token=self._tokens.issue(self._clock.now_s()), time_s=self._clock.utc_s())
        return message_of(fresh, self.topics.base)

    def _note_version(self, version: Version) -> None:
        """Publish which version of MQTT is used, and warn of what the older one hides."""
        if version is self._version:
            return
        before, self._version = self._version, version
        self.reconfigure(self._config)
        if version is Version.V311:
            self._publish_event(EventCode.MQTT_3_1_1)
        elif before is not None:
            self._publish_event(EventCode.MQTT_5)


def settings_of(site: Site) -> BrokerSettings:
    """Return how a site's broker is reached."""
    config = site.config
    return broker_of(
        config.mqtt,
        site.folder,
        client_id=config.client_id,
        username=config.mqtt.username,
        password=site.password,
    )
