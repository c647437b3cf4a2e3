"""The composition root: builds every part of the gateway and connects them.

`Parts.__init__` names every part in the order in which it depends on others. Nothing is decided here.
"""

from __future__ import annotations

import asyncio
import secrets
from collections.abc import Sequence
from functools import partial

from gateway.app.capture_socket import CaptureSocket, socket_path
from gateway.app.health import Health
from gateway.app.io import MACHINE, Io
from gateway.app.plant import Plant
from gateway.app.plugins import NAMES, PluginRunner
from gateway.app.record_log import RecordLog, log_failure
from gateway.app.site import Site
from gateway.app.uplink import Uplink
from gateway.config.convert import least_watchdog_s, policy_of, rights_of, setups_in, timing_of, wiring_of
from gateway.contract import (
    MAX_TTL_S,
    ForgetRecord,
    Latest,
    PublishEvent,
    RecordBus,
    RecordWriter,
)
from gateway.line import LineHost
from gateway.mqtt import Inbox, IncomingCommands
from gateway.plugins.history.delivery import StoredRecords
from gateway.plugins.history.plugin import History
from gateway.plugins.interface import Gateway, Plugin
from gateway.starters import (
    MAX_AHEAD_S,
    Commands,
    Dispatcher,
    KnownWatchdogs,
    Policy,
    PublishedFaults,
    RunToken,
    StarterServices,
    Tokens,
)
from gateway.store import HISTORY_FILE, STATE_FILE, HistoryStore, StateStore, import_late
from gateway.system.clock import ClockWatch, SystemClock
from gateway.system.stalls import SuspendWatch
from gateway.system.systemd import Notifier

HOLD_S = MAX_TTL_S + MAX_AHEAD_S  # how long an old command might still pass for a new one


class Parts:
    """The parts of one gateway. All calls on the app's loop."""

    def __init__(
        self, site: Site, *, notifier: Notifier, watchdog_every_s: float | None = None, io: Io = MACHINE
    ) -> None:
        self.site = site
        self._io = io
        self.clock = SystemClock()
        self._started_s = self.clock.utc_s()
        self.clock_watch = ClockWatch(site.config.gateway.clock, ask=io.is_clock_synchronised)
        self._suspend_watch = SuspendWatch(self.clock.now_s)
        self._boot = RunToken(secrets.token_hex(8))
        self._tokens = Tokens(self._boot)
        self._bus = RecordBus(log_failure)
        self._records = RecordWriter(self._bus, self.clock, boot=self._boot.run)
        self.publish_event: PublishEvent = partial(self._records.event, "")  # of the gateway's own
        self.latest = Latest()
        self.state = self._build_state()
        self.uplink = Uplink(
            site,
            self._tokens,
            store=self.state.store,
            clock=self.clock,
            sink=self._bus,
            publish_event=self.publish_event,
        )
        self.watchdogs = KnownWatchdogs(self.state.documents, in_thread=asyncio.to_thread)
        self.policy = self._build_policy()
        self.history = self._build_history()
        self.services = self._build_services()
        self.plant = self._build_plant()
        self.host = LineHost(self.plant.handle, has_thread=io.has_line_thread)
        self.health = self._build_health(notifier, watchdog_every_s)
        self.plant.build(self.host, site.config.lines, self.health)
        self.watch_lines()
        self.dispatcher = self._build_dispatcher()
        self.commands = self._build_commands()
        self.incoming = self._build_incoming()
        self._inbox = Inbox(
            self.uplink.topics,
            take=self.incoming.take,
            refuse=self.dispatcher.refuse_unread,
            now_s=self.clock.now_s,
        )
        path = socket_path(site.config, site.folder)
        self.capture = CaptureSocket(path, self.plant.lines, self.host.capture, self.clock)
        gateway = self._build_gateway()
        self.plugins = tuple(PluginRunner(name, site, gateway) for name in NAMES)
        self._connect()

    def _connect(self) -> None:
        self.uplink.disk_sync.on_recalled = self.history.note_left
        self.state.follow(self.uplink.disk_sync.note_news)
        self.state.commands.row_of = self.uplink.stage
        self.health.note_link(None)
        self.uplink.connect(on_incoming=self._inbox.put, on_link=self.health.note_link)
        self._bus.connect(
            self.state,  # the audit has a decision before any client can read of it
            self.policy,  # states: starts and standstills
            self.services,  # what commands set
            RecordLog(self.clock),
            self.history,  # makes starts and trips of readings and records
            self.uplink.publisher,
            self.commands,  # who sent a command may follow its results
            self.latest,
            self.uplink.leftovers,
            *self.plugins,
        )

    def forget(self, starters: Sequence[str]) -> None:
        """Have the broker delete what it retains of starters."""
        self._bus.put(ForgetRecord(starters=tuple(starters)))

    def forget_lines(self, lines: Sequence[str]) -> None:
        """Have the broker delete what it retains of lines."""
        self._bus.put(ForgetRecord(lines=tuple(lines)))

    def watch_lines(self) -> None:
        """Have the health of the site's present lines watched."""
        config = self.site.config
        self.health.watch(
            self.plant.lines.values(),
            shortest_watchdog_s=least_watchdog_s(config),
            computed=self.site.computed,
            wiring=wiring_of(config),
        )

    def _build_state(self) -> StateStore:
        return StateStore(
            self.site.state_dir / STATE_FILE,
            boot=self._boot.run,
            clock=self.clock,
            hold_s=HOLD_S,
            has_operators=bool(self.site.config.operators),
            publish_event=self.publish_event,
        )

    def _build_policy(self) -> Policy:
        config = self.site.config
        return Policy(
            policy_of(config),
            [starter.name for starter in config.starters],
            rights=rights_of(config),
            records=self._records,
            documents=self.state.documents,
            watchdogs=self.watchdogs,
            published_faults=PublishedFaults(self.state.documents),
        )

    def _build_services(self) -> StarterServices:
        return StarterServices(past=self.history)

    def _build_plant(self) -> Plant:
        return Plant(
            publish_event=self.publish_event,
            forget=self.forget,
            policy=self.policy,
            services=self.services,
            records=self._records,
            refresh_s=self.site.config.mqtt.refresh_s,
            on_readings=self.history.take_readings,
            language=self.site.config.gateway.language,
            make_opener=lambda table: self._io.make_opener(table.port, timing_of(table)),
        )

    def _build_history(self) -> History:
        return History(
            HistoryStore(
                self.site.state_dir / HISTORY_FILE, prepare=partial(import_late, self.site.state_dir)
            ),
            setups_in(self.site.config),
            outbox=StoredRecords(
                keep=self.uplink.keep,
                payloads=self.uplink.disk_sync.payloads,
                let_go=self.uplink.disk_sync.let_go,
            ),
            records=self._records,
            publish_event=self.publish_event,
            policy=self.policy,
        )

    def _build_dispatcher(self) -> Dispatcher:
        return Dispatcher(
            self.plant.starters,
            rights=rights_of(self.site.config),
            records=self._records,
            journal=self.state.commands,
            policy=self.policy,
            stood_still_s=self._suspend_watch.ended_s,
            set_baseline=self.history.set_baseline,
            on_stop=self.uplink.renew_token,
            provable_s=HOLD_S,
        )

    def _build_incoming(self) -> IncomingCommands:
        return IncomingCommands(
            self.commands,
            dispatcher=self.dispatcher,
            clock=self.clock,
            publish_event=self.publish_event,
        )

    def _build_commands(self) -> Commands:
        return Commands(
            self.dispatcher,
            self._tokens,
            clock=self.clock,
            clock_watch=self.clock_watch,
            suspend_watch=self._suspend_watch,
            restate=self.uplink.restate,
            publish_event=self.publish_event,
        )

    def _build_gateway(self) -> Gateway:
        return Gateway(
            name=self.site.config.gateway.name,
            clock=self.clock,
            records=self._records,
            publish_event=self.publish_event,
            latest=self.latest,
            commands=self.commands,
            dispatcher=self.dispatcher,
            tokens=self._tokens,
            policy=self.policy,
            documents=self.state.documents,
            starters=self.plant.starters,
            lines=lambda: self.plant.lines,
            mqtt=self.uplink,
            started_s=self._started_s,
            clock_doubt=self.clock_watch.doubt,
            progress=self.host.progress,
            loops={"gateway": self.health.lag, "lines": self.host.lag},
            stored=self.history.stored,
            plugin=self._plugin,
            make_web_server=self._io.make_web_server,
            in_thread=asyncio.to_thread,
        )

    def _plugin(self, name: str) -> Plugin | None:
        """Return a plugin that runs now."""
        return next((each.plugin for each in self.plugins if each.name == name), None)

    def _build_health(self, notifier: Notifier, watchdog_every_s: float | None) -> Health:
        return Health(
            progress=self.host.progress,
            publisher=self.uplink.publisher,
            sink=self._bus,
            notifier=notifier,
            watchdog_every_s=watchdog_every_s,
            lines_lag=self.host.lag,
            publish_event=self.publish_event,
        )
