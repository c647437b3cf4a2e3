"""The composition root: builds the gateway from its configuration and runs it; decides nothing itself."""

from __future__ import annotations

import asyncio
import logging
import secrets
from collections.abc import Awaitable, Callable
from pathlib import Path

from gateway import __version__
from gateway.capture_socket import capture_of
from gateway.clock import Clock, ClockWatch, SystemClock
from gateway.config.prospects import computed_of, prospects_of
from gateway.config.schema import Config
from gateway.config.setups import least_watchdog_s, policy_of, rights_of, setups_of, timing_of, tls_files_of
from gateway.durable.keeper import Keeper
from gateway.line.client import LineClient
from gateway.line.deafness import DEAF
from gateway.line.gaps import start_order
from gateway.line.host import LineHost
from gateway.line.outcome import Outcome
from gateway.line.serial_port import SerialOpener
from gateway.mqtt.boot import Boot
from gateway.mqtt.broker import BrokerConnection
from gateway.mqtt.intake import MAX_AHEAD_S, MAX_TTL_S, Incoming, Intake, Rejection
from gateway.mqtt.outbox import Outbox
from gateway.mqtt.payload import GatewayInfo, Operator, Payloads
from gateway.mqtt.publisher import Publisher
from gateway.mqtt.settings import BrokerSettings, TlsSettings
from gateway.mqtt.topics import Topics
from gateway.repetition import Repetition
from gateway.starters.commander import Commander
from gateway.starters.companions import Companions
from gateway.starters.memory import FileMemory, NoMemory
from gateway.starters.polling import polls_of
from gateway.starters.precautions import Precautions
from gateway.starters.records import EventRecord, Severity
from gateway.starters.sequence import Sequence
from gateway.starters.telemetry import StarterTelemetry
from gateway.systemd import Notifier
from gateway.vitals import Vitals

log = logging.getLogger(__name__)

RESTART_PAUSE_S = 1.0
FAREWELL_S = 3.0
MEMORY_FILE, IDENTITIES_FILE = "precautions.json", "identities.json"  # in state_dir


class App:
    """One gateway, from start to end; make a new one for another configuration."""

    def __init__(
        self,
        config: Config,
        *,
        folder: Path,
        password: str | None,
        notifier: Notifier,
        watchdog_every_s: float | None = None,
        clock: Clock | None = None,
    ) -> None:
        self._clock = clock or SystemClock()
        self._clock_watch = ClockWatch(config.gateway.clock)
        self._sequence = Sequence()
        boot = secrets.token_hex(8)
        topics = Topics(config.base)
        self._boot = Boot(boot)
        payloads = Payloads(topics, self._boot)
        outbox = Outbox(last_topic=topics.gateway_status, pack=payloads.history)
        self._publisher = Publisher(payloads, outbox, self._clock)
        self._publisher.set_info(_info(config))
        self._intake = Intake(topics, self._boot)
        self._broker = BrokerConnection(
            _broker_settings(config, folder=folder, password=password),
            outbox,
            command_filter=topics.command_filter,
            will=self._publisher.will,
            on_incoming=self._take,
            on_link=self._note_link,
        )
        self._publisher.wake_with(self._broker.wake)
        self._host = LineHost(self)
        self._lines: list[LineClient] = []
        self._starters: dict[str, StarterTelemetry] = {}
        self._by_unit: dict[tuple[str, int], StarterTelemetry] = {}
        self._companions = Companions(self._publisher)
        self._precautions = self._build_precautions(config, folder / config.gateway.state_dir)
        self._build_lines(config)
        self._keeper = Keeper(
            folder / config.gateway.state_dir,
            boot=boot,
            clock=self._clock,
            hold_s=MAX_TTL_S + MAX_AHEAD_S,
            is_read_only=not config.operators,
            tell=self.tell,
            on_recalled=lambda commands: self._commander.recall(commands),
        )
        self._commander = Commander(
            self._starters,
            rights=rights_of(config),
            sink=self._keeper.sink(self._companions),
            clock=self._clock,
            sequence=self._sequence,
            journal=self._keeper.journal,
            precautions=self._precautions,
        )
        self._companions.add_fast_lanes(
            precautions=self._precautions,
            sink=self._keeper.sink(self._companions),
            clock=self._clock,
            sequence=self._sequence,
            may_write=bool(config.operators),
        )
        self._capture = capture_of(config, folder, self._host.capture, self._clock)
        self._vitals = Vitals(
            self._lines,
            progress=self._host.progress,
            publisher=self._publisher,
            notifier=notifier,
            watchdog_every_s=watchdog_every_s,
            lines_lag=self._host.lag,
            shortest_watchdog_s=least_watchdog_s(config),
            tell=self.tell,
            computed={line.table.name: computed_of(line) for line in prospects_of(config)},
        )

    async def run(self, ending: asyncio.Future[str]) -> None:
        """Serve until `ending` has a reason, then end in order: nothing is written to any starter."""
        tasks = [
            asyncio.create_task(_supervise(name, work))
            for name, work in (
                ("vitals", self._vitals.run),
                ("publisher", self._publisher.run),
                ("broker", self._broker.run),
                ("capture", self._capture.run),
            )
        ]
        for starter in self._starters.values():
            starter.start()
        await self._host.start()
        self._keeper.start(__version__)
        self._companions.start()
        try:
            reason = await ending
            log.info("ending: %s", reason)
            await self._commander.close()
            await self._host.stop()
            for starter in self._starters.values():
                await starter.close()
            await self._companions.close()
            await self._precautions.identities.close()
            await self._keeper.close(reason)
            await self._broker.close(self._publisher.farewell(reason), within_s=FAREWELL_S)
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    def tell(self, code: str, severity: Severity, text: str, line: str = "", **more: object) -> None:
        """Publish an event of the gateway's own."""
        data = {"line": line, **more} if line else {}
        self._publisher.put(
            EventRecord("", code, severity, text, self._clock.utc_s(), self._sequence.take(), data)
        )

    # The lines' listener; called on the app's loop.

    def on_poll(self, line: str, key: str, unit: int, outcome: Outcome) -> None:
        """Hear what became of a poll."""
        self._by_unit[line, unit].on_poll(key, outcome)

    def on_unit(self, line: str, unit: int, is_answering: bool, reason: str, frames: tuple[str, ...]) -> None:  # noqa: FBT001 - LineListener's shape
        """Hear that a unit began to answer or went silent."""
        self._by_unit[line, unit].on_unit(is_answering=is_answering, reason=reason, frames=frames)
        self._vitals.note_change()

    def on_trouble(self, line: str, code: str, unit: int, text: str, frames: tuple[str, ...]) -> None:
        """Hear what is wrong on a line: two starters with one address, or one that talks unasked."""
        self.tell(code, Severity.ERROR, f"line {line}: {text}", line, unit=unit, frames=list(frames))

    def on_port(self, line: str, is_open: bool, reason: str) -> None:  # noqa: FBT001 - LineListener's shape
        """Hear that a port was opened or is away: then none of its starters answers."""
        if is_open:
            self.tell("port_open", Severity.INFO, f"line {line}: the port is open", line)
        else:
            code = "port_deaf" if DEAF in reason else "port_away"
            self.tell(code, Severity.ERROR, f"line {line}: {reason}", line)
            for (name, _), starter in self._by_unit.items():
                if name == line:
                    starter.on_unit(is_answering=False, reason=reason)
        self._vitals.note_port(line, "" if is_open else reason)

    def _build_precautions(self, config: Config, state_dir: Path) -> Precautions:
        return Precautions(
            policy_of(config),
            [starter.name for line in config.lines for starter in line.starters],
            rights=rights_of(config),
            sink=self._publisher,
            clock=self._clock,
            sequence=self._sequence,
            memory=FileMemory(state_dir / MEMORY_FILE) if config.operators else NoMemory(),
            identities_memory=FileMemory(state_dir / IDENTITIES_FILE) if config.operators else NoMemory(),
        )

    def _build_lines(self, config: Config) -> None:
        for line in config.lines:
            setups = setups_of(line)
            timing = timing_of(line)
            watchdogs_s = {each.address: each.watchdog_s for each in line.starters if each.watchdog_s}
            client = self._host.add_line(
                name=line.name,
                opener=SerialOpener(line.port, line.baud, timing.framing),
                timing=timing,
                polls=start_order((poll for setup in setups for poll in polls_of(setup)), watchdogs_s),
                allowance_s=line.adapter_allowance_s,
                seed=secrets.randbits(32),
                deaf_after_s=line.deaf_after_s,
            )
            self._lines.append(client)
            for setup in setups:
                starter = StarterTelemetry(
                    setup,
                    line=client,
                    sink=self._precautions.witness,
                    clock=self._clock,
                    sequence=self._sequence,
                    identities=self._precautions.identities,
                )
                self._starters[setup.name] = self._by_unit[line.name, setup.address] = starter
                self._companions.add(starter)

    def _take(self, incoming: Incoming) -> None:
        """Pass an operator's message on, or tell its sender why not."""
        verdict = self._intake.judge(
            incoming,
            utc_s=self._clock.utc_s(),
            received_s=self._clock.now_s(),
            clock_is_synchronised=self._clock_watch.is_synchronised(),
        )
        match verdict:
            case Rejection():
                self._commander.reject(verdict, verdict.code, verdict.text)
            case None:
                log.debug("topic=%s is no command", incoming.topic[:200])
            case _:
                self._commander.submit(verdict)

    def _note_link(self, is_connected: bool, trouble: str) -> None:  # noqa: FBT001 - the callback's shape
        if is_connected:
            self._boot.connected(self._clock.now_s())
            self.tell("broker_connected", Severity.INFO, "connected to the broker")
        else:
            self._boot.disconnected()
            self._publisher.restate()  # with the boot token of the next connection
            self.tell("broker_away", Severity.WARNING, trouble)
        self._vitals.note_link(trouble)


async def _supervise(name: str, work: Callable[[], Awaitable[None]]) -> None:
    """Run one of the app's loops for ever; what fails here touches neither the lines nor the other loops."""
    repetition = Repetition()
    while True:
        try:
            await work()
        except Exception as error:
            if repetition.is_news(error):
                log.exception("task=%s failed and is started again, as often as it takes", name)
        else:
            return
        await asyncio.sleep(RESTART_PAUSE_S)


def _info(config: Config) -> GatewayInfo:
    return GatewayInfo(
        version=__version__,
        starters=tuple(starter.name for line in config.lines for starter in line.starters),
        lines=tuple(line.name for line in config.lines),
        operators=tuple(Operator(each.client, each.may, each.starters) for each in config.operators),
        groups=policy_of(config).groups,
    )


def _broker_settings(config: Config, *, folder: Path, password: str | None) -> BrokerSettings:
    mqtt = config.mqtt
    return BrokerSettings(
        host=mqtt.host,
        port=mqtt.port,
        client_id=config.client_id,
        username=mqtt.username,
        password=password,
        tls=TlsSettings(*tls_files_of(config, folder)) if mqtt.is_tls else None,
        keepalive_s=mqtt.keepalive_s,
        seed=secrets.randbits(32),
    )
