"""The gateway's way up: what waits to be said, and the connection to the broker.

The connection can be moved to another broker, or another login, while everything else goes on.
"""

from __future__ import annotations

import asyncio
import logging
import secrets
from collections.abc import Callable, Sequence

from gateway import __version__
from gateway.app.site import Site
from gateway.config.convert import policy_of, rights_of, tls_files_of
from gateway.config.schema import Config
from gateway.mqtt.connection.broker import BrokerConnection
from gateway.mqtt.connection.reconnect import Version
from gateway.mqtt.connection.settings import BrokerSettings, TlsSettings
from gateway.mqtt.contract.commands import Incoming
from gateway.mqtt.contract.freshness import Tokens
from gateway.mqtt.contract.payloads import GatewayInfo, Message, Payloads
from gateway.mqtt.contract.topics import Topics
from gateway.mqtt.outbox.disk_sync import DiskSync, PublishEvent
from gateway.mqtt.outbox.outbox import Outbox
from gateway.mqtt.publisher import Publisher
from gateway.records import ResultRecord, Severity
from gateway.storage.outbox import OutboxDisk
from gateway.system.clock import Clock

log = logging.getLogger(__name__)

FAREWELL_S = 3.0
KEEP_WITHIN_S = 2.0
OLD_MQTT = (
    "the broker refuses MQTT 5, so 3.1.1 is spoken. Lost: the retained flag of commands that are delivered "
    "live, their message expiry, response topic and correlation data, the limit on a packet's size, and why "
    "a message is refused. Use a broker that speaks MQTT 5"
)
MOVED = "the configuration names another broker or another login"


class Uplink:
    """Speaks MQTT below one base; all calls on the app's loop."""

    def __init__(
        self,
        site: Site,
        tokens: Tokens,
        *,
        clock: Clock,
        tell: PublishEvent,
    ) -> None:
        self._on_incoming: Callable[[Incoming], None]
        self._on_link: Callable[[bool, str], None]
        self._connection: BrokerConnection
        self._seed = secrets.randbits(32)
        self._settings = self._settings_of(site)
        self.topics = Topics(site.config.base)
        self._tokens = tokens
        self._clock = clock
        self._tell = tell
        self._version: Version | None = None
        self._payloads = Payloads(self.topics, tokens.boot)
        self.outbox = Outbox(
            last_topic=self.topics.gateway_status, pack=self._payloads.history, boot=tokens.boot.run
        )
        self.publisher = Publisher(self._payloads, self.outbox, clock)
        self.spooler = DiskSync(
            self.outbox, OutboxDisk(site.state_dir), clock=clock, publish_event=tell, wake=self.publisher.wake
        )
        self._config = site.config
        self.tell_info(site.config)
        self._serving: asyncio.Task[None] | None = None
        self._moved = asyncio.Event()

    def connect(
        self, *, on_incoming: Callable[[Incoming], None], on_link: Callable[[bool, str], None]
    ) -> None:
        """Make the connection, which `run` opens; once, before anything else is called.

        `on_incoming` gets every message on a command topic, `on_link` every change of the connection.
        """
        self._on_incoming, self._on_link = on_incoming, on_link
        self._connection = self._made()

    def tell_info(self, config: Config) -> None:
        """Publish what this gateway is."""
        self._config = config
        self.publisher.set_info(
            GatewayInfo(
                version=__version__,
                starters=tuple(starter.name for line in config.lines for starter in line.starters),
                lines=tuple(line.name for line in config.lines),
                operators=rights_of(config).operators,
                groups=policy_of(config).groups,
                mqtt_version=self._version,
            )
        )

    def restate(self) -> None:
        """Publish the present boot and a new token: those of before count no more."""
        self.publisher.restate()
        self._connection.beat()

    async def run(self) -> None:
        """Stay connected for ever, to whatever broker the latest configuration names."""
        while True:
            self._serving = asyncio.create_task(self._connection.run(), name="connection")
            try:
                await asyncio.wait((self._serving,))
            finally:
                self._serving.cancel()
                await asyncio.wait((self._serving,))
            if not self._serving.cancelled():
                self._serving.result()
            await self._moved.wait()
            self._moved.clear()

    async def move(self, site: Site) -> None:
        """Say goodbye and connect as this site wants it, if that is otherwise than now."""
        settings = self._settings_of(site)
        if settings == self._settings:
            return
        await self.close(MOVED)
        if self._serving is not None:
            self._serving.cancel()
            await asyncio.wait((self._serving,))
        self._settings = settings
        self._connection = self._made()
        is_connected = False
        self._on_link(is_connected, f"moving to broker {settings.address}: {MOVED}")
        self._moved.set()

    def start(self) -> None:
        """Begin to keep what waits; the disk is opened elsewhere."""
        self.spooler.start()

    def tell_again(self, results: Sequence[ResultRecord]) -> None:
        """Publish final results that a crash may have kept back, unless the outbox has them too."""

        def tell() -> None:
            for result in results:
                self.publisher.put(result)

        self.spooler.when_recalled(tell)

    async def close(self, reason: str) -> None:
        """Say what waits, and that the gateway is offline."""
        await self._connection.close(self.publisher.farewell(reason), within_s=FAREWELL_S)

    async def end(self) -> None:
        """Keep what could not be said, for the next run; after `close`."""
        await self.spooler.close(within_s=KEEP_WITHIN_S)

    def _made(self) -> BrokerConnection:
        connection = BrokerConnection(
            self._settings,
            self.outbox,
            command_filter=self.topics.command_filter,
            will=self.publisher.will,
            on_incoming=self._on_incoming,
            on_link=self._on_link,
            on_notice=lambda notice: self._tell(notice.code, Severity.ERROR, notice.text, {}),
            pulse=self._fresh,
            on_version=self._note_version,
        )
        self.publisher.wake_with(connection.wake)
        return connection

    def _fresh(self) -> Message:
        """Return the proof of freshness of this moment, for the live connection only."""
        return self._payloads.fresh(self._tokens.issue(self._clock.now_s()), self._clock.utc_s())

    def _note_version(self, version: Version) -> None:
        """Publish by which version the broker is spoken to, and warn of what the older one hides."""
        if version is self._version:
            return
        before, self._version = self._version, version
        self.tell_info(self._config)
        if version is Version.V311:
            self._tell("mqtt_3_1_1", Severity.WARNING, OLD_MQTT, {})
        elif before is not None:
            self._tell("mqtt_5", Severity.INFO, "the broker takes MQTT 5 again", {})

    def _settings_of(self, site: Site) -> BrokerSettings:
        mqtt = site.config.mqtt
        return BrokerSettings(
            host=mqtt.host,
            port=mqtt.port,
            client_id=site.config.client_id,
            username=mqtt.username,
            password=site.password,
            tls=TlsSettings(*tls_files_of(site.config, site.folder)) if mqtt.is_tls else None,
            keepalive_s=mqtt.keepalive_s,
            seed=self._seed,
        )
