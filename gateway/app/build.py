"""The composition root: builds every part of the gateway, in the order in which one depends on others.

Nothing is decided here. `gateway.App` runs, reconfigures and ends what `build` returns.
"""

from __future__ import annotations

import asyncio
import secrets
from functools import partial

from gateway.app.capture_socket import CaptureSocket, socket_path
from gateway.app.gateway import App
from gateway.app.health import Health
from gateway.app.io import MACHINE, Io
from gateway.app.plant import Plant
from gateway.app.plugins import NAMES, PluginRunner
from gateway.app.record_log import RecordLog, log_failure
from gateway.app.site import Site
from gateway.app.uplink import Uplink
from gateway.config import policy_of, rights_of, setups_in, timing_of
from gateway.contract import Latest, PublishEvent, RecordWriter
from gateway.line import LineHost
from gateway.mqtt import Inbox, IncomingCommands
from gateway.plugins.history.delivery import StoredRecords
from gateway.plugins.history.plugin import History
from gateway.plugins.interface import Gateway, Plugin
from gateway.starters import (
    Commands,
    Policy,
    Proofs,
    Tokens,
    serve,
)
from gateway.store import HISTORY_FILE, STATE_FILE, HistoryStore, StateStore
from gateway.system.clock import ClockWatch, SystemClock
from gateway.system.stalls import SuspendWatch
from gateway.system.systemd import Notifier


def build(site: Site, *, notifier: Notifier, watchdog_every_s: float | None = None, io: Io = MACHINE) -> App:
    """Return a gateway that has not begun; call it on the loop that will run it."""
    config = site.config
    starters_in, rights = setups_in(config), rights_of(config)

    # Time, the run's tokens, and the writer that takes every record to all who want it.
    clock = SystemClock()
    started_s = clock.utc_s()
    clock_watch = ClockWatch(config.gateway.clock, ask=io.is_clock_synchronised)
    suspend_watch = SuspendWatch(clock)
    tokens = Tokens(secrets.token_hex(8))
    records = RecordWriter(clock, log_failure, boot=tokens.run)
    publish_event: PublishEvent = partial(records.event, "")  # of the gateway's own

    # What is stored, and the way to the broker, which needs the store.
    state = StateStore(
        site.state_dir / STATE_FILE,
        boot=tokens.run,
        publish_event=publish_event,
    )
    uplink = Uplink(site, tokens, store=state.store, clock=clock, sink=records, publish_event=publish_event)
    latest = Latest(uplink.outbox.records)
    state.on_news = uplink.disk_sync.note_news
    state.commands.row_of = uplink.stage
    policy = Policy(
        policy_of(config),
        [setup.name for setup in starters_in],
        rights=rights,
        records=records,
        documents=state.documents,
    )
    policy.motor_history.watch_only(setup.name for setup in starters_in if setup.is_enabled)
    history = History(
        HistoryStore(site.state_dir / HISTORY_FILE),
        starters_in,
        outbox=StoredRecords(
            keep=uplink.keep, payloads=uplink.disk_sync.payloads, let_go=uplink.disk_sync.let_go
        ),
        records=records,
        publish_event=publish_event,
        policy=policy,
        traced=config.traced,
        has_page=config.web is not None,
    )
    uplink.disk_sync.on_recalled = history.note_left

    # The lines with their starters, and who watches the lines.
    plant = Plant(
        publish_event=publish_event,
        policy=policy,
        serve=partial(serve, past=history),
        records=records,
        refresh_s=config.mqtt.refresh_s,
        on_readings=history.take_readings,
        language=config.gateway.language,
        make_opener=lambda table: io.make_opener(table.port, timing_of(table)),
    )
    host = LineHost(plant.handle, has_thread=io.has_line_thread)
    health = Health(
        progress=host.progress,
        publisher=uplink.publisher,
        sink=records,
        notifier=notifier,
        watchdog_every_s=watchdog_every_s,
        lines_lag=host.lag,
        publish_event=publish_event,
    )
    plant.build(host, config.lines, health)
    health.reconfigure(plant.lines.values(), site)

    # Commands: from the broker's topics, from plugins, and by the page.
    proofs = Proofs(
        tokens=tokens,
        clock=clock,
        clock_watch=clock_watch,
        suspend_watch=suspend_watch,
        restate=uplink.restate,
        publish_event=publish_event,
    )
    commands = Commands(
        starters=plant.starters,
        policy=policy,
        proofs=proofs,
        records=records,
        journal=state.commands,
        set_baseline=history.set_baseline,
        on_stop=uplink.renew_token,
    )
    incoming = IncomingCommands(commands, clock=clock, publish_event=publish_event)
    inbox = Inbox(uplink.topics, take=incoming.take, refuse=commands.refuse_unread, now_s=clock.now_s)
    uplink.connect(site, on_incoming=inbox.put, on_link=health.note_link)

    # The plugins see the gateway through one object; each runs while the configuration wants it.
    plugins: list[PluginRunner] = []

    def plugin_of(name: str) -> Plugin | None:
        return next((each.plugin for each in plugins if each.name == name), None)

    gateway = Gateway(
        name=config.gateway.name,
        clock=clock,
        records=records,
        publish_event=publish_event,
        latest=latest,
        commands=commands,
        tokens=tokens,
        policy=policy,
        documents=state.documents,
        starters=plant.starters,
        lines=lambda: plant.lines,
        mqtt=uplink,
        started_s=started_s,
        clock_doubt=clock_watch.doubt,
        progress=host.progress,
        loops={"gateway": health.lag, "lines": host.lag},
        stored=history.stored,
        series=history.series,
        plugin=plugin_of,
        make_web_server=io.make_web_server,
        in_thread=asyncio.to_thread,
    )
    plugins += [PluginRunner(name, site, gateway) for name in NAMES]

    records.connect(
        state.audit,  # it has a decision before any client can read of it
        policy,  # states: starts and standstills
        RecordLog(clock),
        history,  # makes starts and trips of readings and records
        uplink.publisher,
        latest,
        uplink.leftovers,
        *plugins,
    )
    return App(
        site=site,
        publish_event=publish_event,
        clock_watch=clock_watch,
        state=state,
        uplink=uplink,
        policy=policy,
        history=history,
        plant=plant,
        host=host,
        health=health,
        commands=commands,
        capture=CaptureSocket(socket_path(config, site.folder), plant.lines, host.capture, clock),
        plugins=tuple(plugins),
    )
