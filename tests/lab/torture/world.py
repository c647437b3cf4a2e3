"""Everything under test, with real processes: broker, starters, supervisor and gateway, recorder."""

from __future__ import annotations

import asyncio
import math
import random
import re
import signal
import time
from collections import Counter
from collections.abc import AsyncIterator, Callable, Iterable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from gateway.app.capacity import prospects_of
from gateway.cli.check import gaps_of_starter
from gateway.config.reading import load
from gateway.line.capacity.outage import WIDE_FACTOR, Gaps, Restart
from tests.lab.torture.machine import MACHINE, sleep_fairly, until
from tests.lab.torture.recorder import Recorder
from tests.lab.torture.scenario import Place, Row
from tests.lab.torture.starters import StartersProcess
from tests.lab.torture.supervisor import Supervisor
from tests.lab.usage import Usage, open_files, usage
from tests.mosquitto import MosquittoBroker
from tests.rig import sites

STARTERS = {"pump": "ssw07", "fan": "ssw06", "mill": "ssw900", "belt": "sst"}
READABLE = {"pump": "P314", "fan": "P313", "mill": "C8.2.5.3", "belt": "R33"}
KEEPALIVE_S = 5
RIGHT_WITHIN_S = 5.0  # after a recovery
QUIET_S = 4.0  # what is asked after a change has been asked by then
ONLINE_WITHIN_S = 5.0
LOOK_S = 0.5  # more than the longest regular gap, and a look must have seen it
STOP_WITHIN_S = 1.0  # over MQTT, beside what the line needs
NOT_NOW = ("busy", "too_many", "expired", "not_fresh")  # the newest token may have been on its way for long
SETTLED_TRIES = 80
SETTLING = "settling-"  # how the ids of the reads of `settled` begin
PACE_S = 0.24  # between commands of one client to one starter, so that none is refused as too many


def site(folder: Path, broker_port: int, place: Place, watchdog_s: int) -> str:
    """Return the configuration of one line with a starter of each family."""
    url = f"mqtt://127.0.0.1:{broker_port}"
    return (
        sites.table("gateway", name="plant", state_dir=f"{folder}/state", clock="trusted")
        + sites.table("mqtt", version=place.mqtt, url=url, keepalive_s=KEEPALIVE_S)
        + sites.line("hall", port=f"{folder}/ttyHALL", deaf_after_s=place.deaf_after_s)
        + "".join(
            sites.starter(name, address, family, watchdog_s=watchdog_s)
            for address, (name, family) in enumerate(STARTERS.items(), 1)
        )
        + sites.ALICE
    )


class Rate(NamedTuple):
    """How much a line carries."""

    per_s: float  # requests
    held: float  # the share of the time for which the machine held us up


@dataclass
class World:
    """What a scenario may touch."""

    state_dir: Path
    broker: MosquittoBroker
    starters: StartersProcess
    gateway: Supervisor
    recorder: Recorder
    gaps: Gaps  # the longest of any starter, computed
    watchdog_s: int  # of every starter
    dice: random.Random
    row: Row = field(default_factory=lambda: Row("", ""))
    commanded: dict[str, int] = field(default_factory=lambda: dict.fromkeys(STARTERS, 0))
    stops_s: list[float] = field(default_factory=list)  # from publishing to the frame on the line, fairly
    ids: int = 0
    samples: list[tuple[Usage, int]] = field(default_factory=list)  # and how many files are open

    @property
    def check(self) -> Callable[[bool, str], None]:
        return self.row.check

    # Commands

    def begin_start(self, starter: str) -> str:
        """Command a start and return its id."""
        self.ids += 1
        self.commanded[starter] += 1
        self.recorder.command(starter, "start", f"start-{self.ids}")
        return f"start-{self.ids}"

    async def start(self, starter: str) -> None:
        """Command a start and wait until it is confirmed."""
        end_s = MACHINE.fair_s() + ONLINE_WITHIN_S
        result = await self.recorder.final(self.begin_start(starter))
        while result["phase"] == "rejected" and MACHINE.fair_s() < end_s:
            await asyncio.sleep(1.0)  # it is being stopped yet, or seems not to answer on a busy machine
            result = await self.recorder.final(self.begin_start(starter))
        self.check(result["phase"] == "confirmed", f"a start of {starter} ended as {result}")

    async def read(self, starter: str, prefix: str = "read-") -> dict[str, Any]:
        """Read a parameter of a starter and return the final result."""
        self.ids += 1
        self.recorder.command(starter, "read", f"{prefix}{self.ids}", parameter=READABLE[starter])
        return await self.recorder.final(f"{prefix}{self.ids}")

    async def settled(self) -> None:
        """Wait until nothing that was sent before can be written any more.

        Each starter's commands are taken in their order, one at a time: so a read that was sent after all
        others is carried out after them.
        """
        for starter in STARTERS:
            for _ in range(SETTLED_TRIES):
                final = await self.read(starter, SETTLING)
                if final["code"] not in NOT_NOW:
                    break
                await asyncio.sleep(PACE_S)
            self.check(final["phase"] == "confirmed", f"a read of {starter} ended as {final}")

    async def stop(self, starter: str, *, within_s: float = 10.0, id_: str = "") -> None:
        """Command a stop; check that its first frame comes within the bound and that the motor obeys."""
        sent_s = time.monotonic()
        self.recorder.publish(f"command/{starter}/alice/stop", {"id": id_} if id_ else "")
        while not (writes := await self._writes(starter, sent_s)):
            if time.monotonic() - sent_s - MACHINE.held_s(sent_s) > within_s:
                self.check(False, f"a stop of {starter} reached no starter within {within_s:g} s")
                return
            await asyncio.sleep(0.02)
        self.stops_s.append(MACHINE.took_s(sent_s, writes[0][0]))

    async def stand(self, starter: str) -> float:
        """Stop a motor and wait until that is confirmed and the motor off; return when it was confirmed."""
        self.ids += 1
        id_ = f"stop-{self.ids}"
        await self.stop(starter, id_=id_)
        final = await self.recorder.final(id_)
        confirmed_s = self.recorder.received_s[f"result/{starter}/alice"]
        self.check(final["phase"] == "confirmed", f"a stop of {starter} ended as {final}")
        report = await self.report()
        self.check(not report["starters"][starter]["is_on"], f"{starter} is on after a confirmed stop")
        return confirmed_s

    # The starters' side

    async def report(self, **options: Any) -> dict[str, Any]:
        """Return what the starters have lived through since the mark."""
        return await self.starters.order("report", **options)

    async def starts(self) -> dict[str, int]:
        """Return how many start frames each starter has received."""
        return {name: each["start_frames"] for name, each in (await self.report())["starters"].items()}

    async def written(self, starter: str, *, since_s: float) -> Counter[str]:
        """Return what was written to a starter since then."""
        return Counter(pdu for _, pdu in await self._writes(starter, since_s))

    async def _writes(self, starter: str, since_s: float) -> list[tuple[float, str]]:
        answer = await self.starters.order("written", starter=starter, since_s=since_s)
        return [(at_s, pdu) for at_s, pdu in answer["writes"]]

    async def fault(self, starter: str) -> bool:
        """Let a fault happen and be reset; return whether the starter was answering all the time."""
        before = self._voices(starter)
        await self.starters.order("fault", starter=starter, number=5)
        await sleep_fairly(self.gaps.regular_s + LOOK_S)
        await self.starters.order("keypad_reset", starter=starter)
        await sleep_fairly(self.gaps.regular_s + LOOK_S)
        return self._voices(starter) == before and before[-1:] == ["answers"]

    def _voices(self, starter: str) -> list[str]:
        """Return when the gateway began to receive a starter, and when it no longer did."""
        return re.findall(rf" gateway: {starter} (answers|went silent)", self.gateway.log)

    async def check_line_timing(self, why: str) -> None:
        """Check that no starter waited longer than computed."""
        await self.check_gap(self.gaps.regular_s, why)

    async def check_gap(self, computed_s: float, why: str) -> None:
        """Check the longest time since the mark that any starter had to wait for a request."""
        gaps = [gap for each in (await self.report())["starters"].values() for gap in each["gaps"]]
        fair_s = max(MACHINE.took_s(*gap) for gap in gaps)
        longest_s = max(to_s - from_s for from_s, to_s in gaps)
        self.row.measurements |= {"gap s": round(longest_s, 2), "computed s": round(computed_s, 2)}
        if longest_s > computed_s:
            self.row.measurements["of the gateway s"] = round(fair_s, 2)
        self.check(fair_s <= computed_s, f"{why}: {fair_s:.2f} s")

    async def rate(self, seconds: float) -> Rate:
        """Return how many requests a second the line carries."""

        async def requests() -> int:
            return sum(each["requests"] for each in (await self.report())["starters"].values())

        before, begun_s = await requests(), time.monotonic()
        await asyncio.sleep(seconds)
        count, took_s = await requests() - before, time.monotonic() - begun_s
        return Rate(count / took_s, MACHINE.held_s(begun_s) / took_s)

    def check_rates(self, before: Rate, during: Rate, *, tolerance: float) -> None:
        """Check that the line was asked as often as before, but for what the machine took."""
        self.row.measurements |= {"polls/s before": round(before.per_s, 2), "during": round(during.per_s, 2)}
        is_same = 1 - tolerance - during.held <= during.per_s / before.per_s <= 1 + tolerance + before.held
        self.check(is_same, f"the line's rate changed: {before} -> {during}")

    # The gateway's side

    async def next_life(self, end: Callable[[], object], *, within_s: float = 10.0) -> float:
        """End a life and wait for the next; return how long until all was shown rightly."""
        lives, begun_s = len(self.gateway.lives), time.monotonic()
        end()
        await self.gateway.until_up(lives=lives + 1, within_s=within_s)
        await self.right(since_s=self.gateway.lives[-1].began_s)
        return time.monotonic() - begun_s

    async def killed(self) -> None:
        """Kill the gateway, and return once it is dead; its supervisor will start another."""
        self.gateway.signal(signal.SIGKILL)
        await until(lambda: self.gateway.lives[-1].ended_s is not None, "the gateway is dead", within_s=5.0)

    async def ready(self, starters: Iterable[str] = STARTERS) -> None:
        """Wait until starters stand still, and the present gateway says so and knows who they are."""
        began_s = self.gateway.lives[-1].began_s
        for starter in starters:
            wanted = {"state": "ready", "quality": "good"}
            await self.recorder.until(f"starter/{starter}/state", since_s=began_s, within_s=60.0, **wanted)
            await until(  # before that it refuses starts
                lambda starter=starter: self.recorder.newest(f"starter/{starter}/info", began_s).get(
                    "firmware"
                ),
                f"{starter} is identified",
                within_s=60.0,
            )

    async def calm(self) -> None:
        """Wait until no starter is polled faster than usual."""

        def is_calm() -> bool:
            states = [self.recorder.newest(f"starter/{name}/state").get("state") for name in STARTERS]
            return set(states) <= {"ready", "running"}

        await until(is_calm, "all motors stand or run", within_s=60.0)
        await asyncio.sleep(QUIET_S)

    async def right(self, *, since_s: float = 0.0, within_s: float = RIGHT_WITHIN_S) -> float:
        """Wait until all states are published as they are, in messages from after `since_s`; return how long.

        Take `since_s` from before whatever makes the gateway speak: it may be quicker than we are.
        """
        begun_s, end_s = time.monotonic(), MACHINE.fair_s() + within_s
        for starter, each in (await self.report())["starters"].items():
            states = ("running", "starting") if each["is_on"] else ("ready", "stopping", "not_ready")

            def is_right(starter: str = starter, states: tuple[str, ...] = states) -> bool:
                shown = self.recorder.newest(f"starter/{starter}/state", since_s)
                return shown.get("quality") == "good" and shown.get("state") in states

            try:
                left_s = max(end_s - MACHINE.fair_s(), 0.0)
                await until(is_right, f"{starter} is {states[0]}", within_s=left_s)
            except TimeoutError as error:
                shown = self.recorder.newest(f"starter/{starter}/state")
                self.check(False, f"state not right within {within_s:g} s: {error}, but {shown}")
                break
        return time.monotonic() - begun_s

    def sample(self) -> Usage:
        """Look at the gateway's process."""
        self.samples.append((usage(self.gateway.pid), open_files(self.gateway.pid)))
        return self.samples[-1][0]


@asynccontextmanager
async def world(folder: Path, restart: Restart, place: Place, *, seed: int) -> AsyncIterator[World]:
    """Set everything up, wait until all is well, and give it to the scenarios."""
    MACHINE.start()
    (folder / "state").mkdir(exist_ok=True)
    # Its sessions outlive a stop, or the recorder would lose what the broker has for it.
    broker = MosquittoBroker(folder / "broker", is_persistent=True)
    broker.start()
    config = folder / "site.toml"
    config.write_text(site(folder, broker.port, place, 0), "utf-8")
    (prospects,) = prospects_of(load(config))
    each = [gaps_of_starter(starter, restart) for starter in prospects.starters]
    gaps = max(each, key=lambda gaps: gaps.hang_s)
    watchdog_s = math.ceil(WIDE_FACTOR * (gaps.hang_s if place.outlasts_hang else gaps.crash_s))
    config.write_text(site(folder, broker.port, place, watchdog_s), "utf-8")
    starters, recorder = StartersProcess(config, watchdog_s), Recorder(broker.port)
    module = "tests.lab.torture.blockable" if place.outlasts_hang else "gateway"
    gateway = Supervisor(module, config, restart)
    dice = random.Random(seed)
    here = World(folder / "state", broker, starters, gateway, recorder, gaps, watchdog_s, dice)
    try:
        await starters.start()
        recorder.start()
        gateway.start()
        await gateway.until_up()
        await here.right(within_s=15.0)
        await asyncio.sleep(1.0)
        await starters.order("mark")
        yield here
    finally:
        await gateway.stop()
        recorder.stop()
        await starters.stop()
        broker.kill()
