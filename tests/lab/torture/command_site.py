"""A site whose starters live in this very process, so that every frame to them can be counted."""

from __future__ import annotations

import asyncio
import json
from collections import Counter
from collections.abc import AsyncIterator, Callable, Iterable
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from gateway.cli.broker_kit.kit import broker_conf
from gateway.cli.demo.simulate import simulated_lines
from gateway.config.load import load, parse
from gateway.line.capacity.outage import Restart
from gateway.sim.core.unit import SimulatedUnit
from tests.config.sites import changed
from tests.end_to_end.site import FOUR_FAMILIES, site_config
from tests.lab.torture.recorder import BASE, Recorder, is_final
from tests.lab.torture.supervisor import Supervisor
from tests.lab.torture.waiting import until
from tests.mosquitto import MosquittoBroker

STARTERS = ("pump", "fan", "mill", "belt")
NOT_NOW = ("busy", "too_many", "expired", "not_fresh")  # the newest token may have been on its way for long
SETTLED_TRIES = 80
SETTLING = "settling-"  # how the ids of these reads begin
READABLE = {"pump": "P314", "fan": "P313", "mill": "C8.2.5.3", "belt": "R33"}
USERS = ("alice", "bob", "victor")
AT_ONCE = Restart(restart_s=0.1, watchdog_s=10.0, abort_s=2.0, start_up_s=2.0)
WRITES = (5, 6, 15, 16, 22, 23)
TOLERANCE_S = 0.001  # the starters share a process with the flooding clients
PACE_S = 0.24  # between commands of one client to one starter, so that none is refused as too many
QUICK = {"ramp_up_s": 0.6, "ramp_down_s": 0.4, "coast_s": 0.4}  # of the motors


class ResultListener(Recorder):
    """Receives results and states, not the commands."""

    def _connected(self, client: Any, *_: Any) -> None:
        gateways = ("gateway/status", "gateway/fresh", "gateway/line/+")
        for topic in ("result/#", "starter/+/state", "starter/+/info", *gateways):
            client.subscribe(f"{BASE}/{topic}", qos=1)

    @property
    def boot(self) -> str:
        return str(self.latest["gateway/status"]["boot"])

    def finals_of_ids(self) -> Counter[str]:
        """Return how many final results each id has had; one that QoS 1 delivered again is still one."""
        return Counter(
            id_
            for id_, *_ in {
                (each["id"], each["time"], each["phase"], each["code"])
                for each in self.results
                if each["id"] and is_final(each) and not each["duplicate"]
            }
        )

    def of(self, id_: str, *, since: int = 0) -> list[dict[str, Any]]:
        """Return what was published of a command, from that result on."""
        return [each for each in self.results[since:] if each["id"] == id_]


@dataclass
class RequestTap:
    """Receives every request to a unit, before the unit itself."""

    unit: SimulatedUnit
    received: list[tuple[float, bytes]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._handle = self.unit.handle
        self.unit.handle = self.handle  # type: ignore[method-assign] # that is the point of it

    def handle(self, pdu: bytes, now_s: float) -> bytes | None:
        self.received.append((now_s, pdu))
        return self._handle(pdu, now_s)

    def writes(self, *, since: int = 0) -> list[tuple[float, bytes]]:
        return [(at_s, pdu) for at_s, pdu in self.received[since:] if pdu[0] in WRITES]


@dataclass
class CommandSite:
    """Broker, starters, gateway, and one who listens."""

    broker: MosquittoBroker
    gateway: Supervisor
    listener: ResultListener
    ears: dict[str, RequestTap]
    failures: list[str] = field(default_factory=list)
    measurements: dict[str, Any] = field(default_factory=dict)
    stops: int = 0
    reads: int = 0

    def check(self, is_right: bool, what: str) -> None:
        if not is_right:
            self.failures.append(what)

    def starts(self) -> int:
        """Return how many start frames all starters have received."""
        return sum(len(ear.unit.start_frames) for ear in self.ears.values())

    def mark(self, starter: str) -> int:
        return len(self.ears[starter].received)

    def written(self, starter: str, *, since: int) -> Counter[bytes]:
        return Counter(pdu for _, pdu in self.ears[starter].writes(since=since))

    def payload(self, id_: str, **fields: Any) -> str:
        """Return a fresh command."""
        return json.dumps({"id": id_, "token": self.listener.token, **fields})

    def results(self, *, since: int) -> list[dict[str, Any]]:
        """Return the results from that one on, but for those of the reads of `settled`."""
        return [each for each in self.listener.results[since:] if not str(each["id"]).startswith(SETTLING)]

    async def result(
        self,
        is_wanted: Callable[[dict[str, Any]], bool],
        what: str,
        *,
        since: int = 0,
        within_s: float = 20.0,
    ) -> dict[str, Any]:
        """Wait for a result."""

        def found() -> list[dict[str, Any]]:
            return [each for each in self.listener.results[since:] if is_wanted(each)]

        await until(lambda: bool(found()), what, within_s=within_s)
        return found()[0]

    async def ready(self, starters: Iterable[str] = STARTERS) -> None:
        """Wait until starters stand still, and the present gateway says so and knows who they are."""
        began_s = self.gateway.lives[-1].began_s
        for starter in starters:
            await self.listener.until(
                f"starter/{starter}/state", since_s=began_s, within_s=60.0, state="ready", quality="good"
            )
            await self._identified(starter, since_s=began_s)

    async def _identified(self, starter: str, *, since_s: float) -> None:
        """Wait until a gateway that began then knows who answers: before that it refuses starts."""
        topic = f"starter/{starter}/info"

        def is_known() -> bool:
            is_new = self.listener.received_s.get(topic, 0.0) >= since_s
            return is_new and bool(self.listener.latest[topic].get("firmware"))

        await until(is_known, f"{starter} is identified", within_s=60.0)

    async def settled(self) -> None:
        """Wait until nothing that was sent before can be written any more.

        Each starter's commands are taken in their order, one at a time: so a read that was sent after all
        others is carried out after them.
        """
        for starter, parameter in READABLE.items():
            for _ in range(SETTLED_TRIES):
                self.reads += 1
                id_ = f"{SETTLING}{self.reads}"
                self.listener.command(starter, "read", id_, parameter=parameter)
                final = await self.listener.final(id_)
                if final["code"] not in NOT_NOW:
                    break
                await asyncio.sleep(PACE_S)
            self.check(final["phase"] == "confirmed", f"a read of {starter} ended as {final}")

    async def stop(self, starter: str) -> None:
        """Stop a motor and wait until it stands and nothing more is written."""
        since, received = len(self.listener.results), self.mark(starter)
        self.stops += 1
        id_ = f"stop-{self.stops}"
        self.listener.publish(f"command/{starter}/alice/stop", json.dumps({"id": id_}))
        final = await self.result(
            lambda each: each["id"] == id_ and is_final(each), f"the end of a stop of {starter}", since=since
        )
        self.check(final["phase"] == "confirmed", f"a stop of {starter} ended as {final}")
        self.check(bool(self.written(starter, since=received)), f"{starter} has received no stop frame")
        unit = self.ears[starter].unit
        await until(lambda: not unit.motor.is_turned_on, f"{starter} is off", within_s=10.0)

    async def begin(self) -> None:
        lives = len(self.gateway.lives)
        self.gateway.start()
        await self.gateway.until_up(lives=lives + 1)
        await self.ready()


@asynccontextmanager
async def command_site(
    folder: Path, *, every_s: float = 0.2, mqtt: str = "auto"
) -> AsyncIterator[CommandSite]:
    """Set it up and wait until all is well; the gateway speaks this version of MQTT."""
    broker = MosquittoBroker(folder / "broker", options=[_queue_of_kit()])
    config = folder / "site.toml"
    others = "".join(
        f'\n[[operator]]\nclient = "{user}"\nmay = ["*"]\nstarters = ["*"]\n' for user in USERS[1:]
    )
    starters = (FOUR_FAMILIES + others).replace("every_s = 0.2", f"every_s = {every_s}")
    text = site_config(broker_port=broker.port, port=f"{folder}/ttyHALL", starters=starters)
    text = text.replace("[gateway]", '[gateway]\nclock = "trusted"')
    config.write_text(text.replace("[mqtt]", f'[mqtt]\nversion = "{mqtt}"'), "utf-8")
    listener, gateway = ResultListener(broker.port), Supervisor.of_gateway(config, AT_ONCE)
    broker.start()
    try:
        async with AsyncExitStack() as stack:
            lines = await stack.enter_async_context(simulated_lines(load(config)))
            bus = lines["hall"].line
            bus.tolerance_s = TOLERANCE_S
            for unit in bus.units:
                unit.motor.data = replace(unit.motor.data, **QUICK)
            ears = {name: RequestTap(bus.unit(address)) for address, name in enumerate(STARTERS, 1)}
            here = CommandSite(broker, gateway, listener, ears)
            listener.start()
            await here.begin()
            yield here
            here.check("Traceback" not in gateway.log, "an unhandled exception is in the log")
            finals = listener.finals_of_ids()
            several = {id_: listener.of(id_) for id_, count in finals.items() if count > 1}
            here.check(not several, f"several finals: {several}")
            await gateway.stop()
    finally:
        await gateway.stop()
        listener.stop()
        broker.kill()


def _queue_of_kit() -> str:
    """Return how much the shipped broker keeps for a client that reads slowly."""
    lines = broker_conf(parse(changed(), "site.toml"), has_bridge=False).splitlines()
    (line,) = (each for each in lines if each.startswith("max_queued_messages "))
    return line


class Pipe:
    """A running `mosquitto_pub -l`: every line is a message, on a topic of its own."""

    def __init__(self, broker: MosquittoBroker, topic: str, version: str, *options: str) -> None:
        where = ("-h", broker.host, "-p", str(broker.port), "-V", version, "-q", "1")
        self._command = ("mosquitto_pub", *where, "-t", f"{BASE}/{topic}", "-l", *options)
        self._process: asyncio.subprocess.Process | None = None

    async def __aenter__(self) -> Pipe:
        self._process = await asyncio.create_subprocess_exec(
            *self._command, stdin=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.DEVNULL
        )
        return self

    async def __aexit__(self, *_: object) -> None:
        """Let it publish all that it was given."""
        assert self._process is not None
        assert self._process.stdin is not None
        self._process.stdin.close()
        await asyncio.wait_for(self._process.wait(), 20.0)

    def say(self, line: str) -> None:
        assert self._process is not None
        assert self._process.stdin is not None
        self._process.stdin.write(line.encode() + b"\n")
