"""The composition root: builds the gateway from its site, runs it, has it changed; decides nothing itself."""

from __future__ import annotations

import asyncio
import logging
import secrets
from collections.abc import Awaitable, Callable, Mapping, Sequence
from typing import Any

from gateway import __version__
from gateway.app.capture_socket import capture_of
from gateway.app.clock_memory import CLOCK_FILE, ClockMemory
from gateway.app.health import Health
from gateway.app.incoming import IncomingCommands
from gateway.app.plant import Plant
from gateway.app.record_bus import RecordBus
from gateway.app.record_log import RecordLog
from gateway.app.site import Site
from gateway.app.uplink import Uplink
from gateway.config.convert import least_watchdog_s, policy_of, rights_of, setups_of
from gateway.config.diff import ConfigChanges, changes_of, fixed
from gateway.config.schema import Config
from gateway.errors import ConfigError, Problem
from gateway.line.thread import LineHost
from gateway.mqtt.connection.inbox import Inbox
from gateway.mqtt.contract.freshness import MAX_AHEAD_S, MAX_TTL_S, Tokens
from gateway.mqtt.contract.run_token import RunToken
from gateway.records import EventRecord, SequenceNumbers, Severity
from gateway.starters.commands.dispatcher import Dispatcher
from gateway.starters.commands.ledger import Proofs
from gateway.starters.identity.registry import IDENTITIES_FILE
from gateway.starters.policy.motor_history import PRECAUTIONS_FILE
from gateway.starters.policy.policy import Policy
from gateway.starters.policy.write_budget import WEAR_FILE
from gateway.starters.services.services import StarterServices
from gateway.starters.telemetry.known_watchdogs import WATCHDOGS_FILE, KnownWatchdogs
from gateway.starters.telemetry.transitions import FAULTS_FILE, PublishedFaults
from gateway.storage.json_file import JsonFile, SwitchedStore
from gateway.storage.state_dir import StateDir
from gateway.system.clock import Clock, ClockWatch, SystemClock
from gateway.system.suspend_watch import SuspendWatch
from gateway.system.systemd import Notifier

log = logging.getLogger(__name__)

RESTART_PAUSE_S = 1.0
SETTLE_S = 15.0  # for commands to starters that a change takes away; a stop lasts 10 s at most


class App:
    """One gateway, from start to end; implements `PlantListener`. All calls on the app's loop."""

    def __init__(
        self,
        site: Site,
        *,
        notifier: Notifier,
        watchdog_every_s: float | None = None,
        clock: Clock | None = None,
    ) -> None:
        self._site = site
        self._clock = clock or SystemClock()
        self._clock_watch = ClockWatch(site.config.gateway.clock)
        self._sequence = SequenceNumbers()
        self._boot = RunToken(secrets.token_hex(8))
        self._tokens = Tokens(self._boot)
        self._records = RecordBus()
        self._standstill = SuspendWatch(self._clock.now_s)
        self._uplink = Uplink(site, self._tokens, clock=self._clock, tell=self.tell)
        self._memories = _memories_of(site)
        self._clock_memory = ClockMemory(self._clock_watch, self._memories[-1], tell=self.tell)
        self._watchdogs = self._build_watchdogs()
        self._precautions = self._build_precautions()
        self._companions = StarterServices(
            self._precautions,
            sink=self._records,
            clock=self._clock,
            sequence=self._sequence,
            may_write=bool(site.config.operators),
        )
        self._plant = Plant(
            self,
            precautions=self._precautions,
            companions=self._companions,
            sink=self._records,
            clock=self._clock,
            sequence=self._sequence,
            refresh_s=site.config.mqtt.refresh_s,
        )
        self._host = LineHost(self._plant.handle)
        self._plant.build(self._host, site.config.lines)
        self._keeper = self._build_keeper()
        self._uplink.outbox.on_delivered = self._keeper.journal.delivered
        self._commander = self._build_commander()
        self._reception = self._build_reception()
        self._inbox = Inbox(
            self._uplink.topics,
            take=self._reception.take,
            refuse=self._commander.refuse_unread,
            now_s=self._clock.now_s,
        )
        self._uplink.connect(on_incoming=self._inbox.put, on_link=self._note_link)
        self._capture = capture_of(site.config, site.folder, self._host.capture, self._clock)
        self._vitals = self._build_vitals(notifier, watchdog_every_s)
        self._is_up = asyncio.Event()
        self._records.connect(
            self._keeper,  # the audit has a decision before anybody can read of it
            self._precautions,  # states: starts and standstills
            self._companions,  # what commands set
            RecordLog(self._clock),
            self._uplink.publisher,
        )

    async def run(self, ending: asyncio.Future[str]) -> None:
        """Serve until `ending` has a reason, then end in order: nothing is written to any starter."""
        tasks = [
            asyncio.create_task(_supervise(name, work))
            for name, work in (
                ("vitals", self._vitals.run),
                ("publisher", self._uplink.publisher.run),
                ("broker", self._uplink.run),
                ("outbox", self._uplink.spooler.run),
                ("history", self._uplink.spooler.pace),
                ("reception", self._reception.run),
                ("capture", self._capture.run),
                ("clock", self._clock_memory.run),
            )
        ]
        await self._host.start()  # before all else: the starters' watchdogs run
        self._keeper.start(
            __version__, on_recalled=self._commander.recall, on_undelivered=self._uplink.tell_again
        )
        await self._plant.start()
        self._uplink.start()
        self._companions.start()
        self._is_up.set()
        try:
            reason = await ending
            log.info("ending: %s", reason)
            await self._commander.close()
            await self._host.stop()
            self._plant.end(f"the gateway ended: {reason}")  # published while all that follows is done
            await self._plant.close()
            await self._companions.close()
            await self._precautions.identities.close()
            await self._clock_memory.close()
            await self._watchdogs.close()
            await self._precautions.told_faults.close()
            await self._keeper.settle()
            await self._uplink.close(reason)
            await asyncio.gather(self._uplink.end(), self._keeper.close(reason))
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    async def change(self, site: Site) -> int:
        """Go over to another site and return how many starters that has ended or replaced.

        What is the same in both goes on untouched; ConfigError for what needs a restart. All of it takes
        effect at one instant, as soon as no starter that is taken away or replaced is under a command.
        Nothing is written to any starter.
        """
        problems = fixed(self._site.config, site.config)
        problems = problems or await _newly_missed(self._watchdogs, self._site.config, site.config)
        if problems:
            raise ConfigError(str(site.folder), problems)
        changes = changes_of(self._site.config, site.config)
        await self._is_up.wait()
        await self._commander.settle(changes.starters_gone, within_s=SETTLE_S)
        ended = self._take_over(site, changes)
        self.tell("reloaded", Severity.INFO, "the new configuration is in force", changes.to_dict())
        await ended
        await self._uplink.move(site)
        return len(changes.starters_gone)

    def tell(self, code: str, severity: Severity, text: str, data: Mapping[str, Any] | None = None) -> None:
        """Publish an event of the gateway's own."""
        self._records.put(
            EventRecord("", code, severity, text, self._clock.utc_s(), self._sequence.take(), data or {})
        )

    def forget(self, starters: Sequence[str]) -> None:
        """Have the broker forget what it retains of starters."""
        self._uplink.publisher.forget(*starters)

    def note_change(self) -> None:
        """Hear that a line's figures have changed in a way that people wait for."""
        self._vitals.note_change()

    def note_starter(self, starter: str, trouble: str) -> None:
        """Hear that a part of a starter cannot be read (why), or that all of it can (empty)."""
        self._vitals.note_starter(starter, trouble)

    def note_port(self, line: str, trouble: str) -> None:
        """Hear that a line's port is open (empty) or away (why)."""
        self._vitals.note_port(line, trouble)

    def _take_over(self, site: Site, changes: ConfigChanges) -> Awaitable[None]:
        """Do everything that must happen at one instant; what is returned ends what was replaced."""
        config, operators = site.config, bool(site.config.operators)
        self._site = site
        ended = self._plant.apply(changes)
        for memory in self._memories:
            memory.is_on = operators
        for name in self._precautions.take_over(policy_of(config), rights=rights_of(config)):
            self._plant.starters[name].restate()
        self._commander.take_over(rights_of(config))
        self._keeper.take_over(is_read_only=not operators)
        if not operators:
            self._companions.forbid_writing()
        self._clock_watch.trust(config.gateway.clock)
        self._capture.lines = tuple(self._plant.lines)
        self._vitals.watch(
            self._plant.lines.values(),
            shortest_watchdog_s=least_watchdog_s(config),
            computed=site.computed,
        )
        for line in changes.lines_forgotten:
            self._uplink.publisher.forget_line(line)
        self._uplink.tell_info(config)
        return ended

    def _build_precautions(self) -> Policy:
        config = self._site.config
        memory, identities_memory, wear_memory, _ = self._memories
        return Policy(
            policy_of(config),
            [starter.name for line in config.lines for starter in line.starters],
            rights=rights_of(config),
            sink=self._records,
            clock=self._clock,
            sequence=self._sequence,
            memory=memory,
            identities_memory=identities_memory,
            wear_memory=wear_memory,
            watchdogs=self._watchdogs,
            told_faults=PublishedFaults(memory=JsonFile(self._site.state_dir / FAULTS_FILE)),
        )

    def _build_watchdogs(self) -> KnownWatchdogs:
        """Return the watchdogs as last known; also where nobody may give commands, they can be changed."""
        return KnownWatchdogs(
            memory=JsonFile(self._site.state_dir / WATCHDOGS_FILE),
            in_thread=asyncio.to_thread,
            on_trouble=self._tell_watchdogs_trouble,
        )

    def _tell_watchdogs_trouble(self, trouble: str) -> None:
        if trouble:
            text = f"the starters' watchdogs cannot be saved for the next run: {trouble}"
            self.tell("memory_away", Severity.WARNING, text)
        else:
            self.tell("memory_back", Severity.INFO, "the starters' watchdogs are saved again")

    def _build_keeper(self) -> StateDir:
        return StateDir(
            self._site.state_dir,
            boot=self._boot.run,
            clock=self._clock,
            hold_s=MAX_TTL_S + MAX_AHEAD_S,
            is_read_only=not self._site.config.operators,
            publish_event=self.tell,
        )

    def _build_commander(self) -> Dispatcher:
        return Dispatcher(
            self._plant.starters,
            rights=rights_of(self._site.config),
            sink=self._records,
            clock=self._clock,
            sequence=self._sequence,
            journal=self._keeper.journal,
            precautions=self._precautions,
            stood_still_s=self._standstill.ended_s,
            proofs=Proofs(MAX_TTL_S + MAX_AHEAD_S, boot=lambda: self._boot.token, renew=self._renew_boot),
        )

    def _renew_boot(self) -> None:
        self._boot.renew()
        self._uplink.publisher.restate()

    def _build_reception(self) -> IncomingCommands:
        return IncomingCommands(
            self._uplink.topics,
            self._tokens,
            commander=self._commander,
            clock=self._clock,
            clock_watch=self._clock_watch,
            standstill=self._standstill,
            restate=self._uplink.restate,
            tell=self.tell,
        )

    def _build_vitals(self, notifier: Notifier, watchdog_every_s: float | None) -> Health:
        return Health(
            self._plant.lines.values(),
            progress=self._host.progress,
            publisher=self._uplink.publisher,
            sink=self._records,
            notifier=notifier,
            watchdog_every_s=watchdog_every_s,
            lines_lag=self._host.lag,
            shortest_watchdog_s=least_watchdog_s(self._site.config),
            tell=self.tell,
            computed=self._site.computed,
        )

    def _note_link(self, is_connected: bool, trouble: str) -> None:  # noqa: FBT001 - the callback's shape
        if is_connected:
            self._boot.connected(self._clock.now_s())
            self.tell("broker_connected", Severity.INFO, "connected to the broker")
        else:
            self._boot.disconnected()
            self._uplink.publisher.restate()  # with the boot token of the next connection
            self.tell("broker_away", Severity.WARNING, trouble)
        self._vitals.note_link(trouble)


def _memories_of(site: Site) -> list[SwitchedStore]:
    """Return what is kept in small files; without operators nothing is."""
    files = (site.state_dir / name for name in (PRECAUTIONS_FILE, IDENTITIES_FILE, WEAR_FILE, CLOCK_FILE))
    return [SwitchedStore(JsonFile(file), is_on=bool(site.config.operators)) for file in files]


async def _newly_missed(watchdogs: KnownWatchdogs, old: Config, new: Config) -> list[Problem]:
    """Return the watchdogs, as last read from the starters, that only the new configuration would miss."""

    async def missed(config: Config) -> dict[str, str]:
        lines = [await watchdogs.missed_on(setups_of(line)) for line in config.lines]
        return {name: text for found in lines for name, text in found.items()}

    before = await missed(old)
    advice = "leave the line as it was, or make the watchdog longer at the starter"
    return [
        Problem("line.starter", f"{name}: {text} (as read from the starter)", advice)
        for name, text in (await missed(new)).items()
        if name not in before
    ]


async def _supervise(name: str, work: Callable[[], Awaitable[None]]) -> None:
    """Run one of the app's loops for ever; what fails here touches neither the lines nor the other loops."""
    while True:
        try:
            await work()
        except Exception:
            log.exception("task=%s failed and is started again, as often as it takes", name)
        else:
            return
        await asyncio.sleep(RESTART_PAUSE_S)
