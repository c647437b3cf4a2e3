"""Everything under test, with real processes: broker, starters, supervisor and gateway, recorder."""

from __future__ import annotations

import asyncio
import math
import os
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

from gateway.line.capacity.outage import WIDE_FACTOR, Gaps, Restart
from tests.lab.torture.machine import MACHINE
from tests.lab.torture.plant_site import STARTERS, computed, site
from tests.lab.torture.process import Starters
from tests.lab.torture.recorder import Recorder
from tests.lab.torture.supervisor import Supervisor
from tests.lab.torture.waiting import sleep_fairly, until
from tests.lab.usage import Usage, open_files, usage
from tests.mosquitto import MosquittoBroker

RIGHT_WITHIN_S = 5.0  # after a recovery
QUIET_S = 4.0  # what is asked after a change has been asked by then
ONLINE_WITHIN_S = 5.0
LOOK_S = 0.5  # more than the longest regular gap, and a look must have seen it
STOP_WITHIN_S = 1.0  # over MQTT, beside what the line needs
NOT_NOW = ("busy", "too_many", "expired", "not_fresh")  # the newest token may have been on its way for long
SETTLED_TRIES = 80
SETTLING = "settling-"  # how the ids of the reads of `settled` begin
READABLE = {"pump": "P314", "fan": "P313", "mill": "C8.2.5.3", "belt": "R33"}
PACE_S = 0.24  # between commands of one client to one starter, so that none is refused as too many


class Rate(NamedTuple):
    """How much a line carries."""

    per_s: float  # requests
    held: float  # the share of the time for which the machine held us up


@dataclass
class World:
    """What a scenario may touch."""

    folder: Path
    state_dir: Path
    broker: MosquittoBroker
    starters: Starters
    gateway: Supervisor
    recorder: Recorder
    gaps: Gaps  # the longest of any starter, computed
    watchdog_s: int  # of every starter
    dice: random.Random
    commanded: dict[str, int] = field(default_factory=lambda: dict.fromkeys(STARTERS, 0))
    failures: list[str] = field(default_factory=list)
    measurements: dict[str, Any] = field(default_factory=dict)
    stops_s: list[float] = field(default_factory=list)  # from publishing to the frame on the line, fairly
    ids: int = 0
    samples: list[tuple[Usage, int]] = field(default_factory=list)  # and how many files are open

    def check(self, is_right: bool, what: str) -> None:
        """Note what does not hold."""
        if not is_right:
            self.failures.append(what)

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

    async def after_death(self, number: signal.Signals, *, within_s: float = 10.0) -> float:
        """Send a deadly signal and wait for the next life; return how long until all was shown rightly."""
        return await self._after(lambda: self.gateway.signal(number), within_s=within_s)

    async def after_hang(self, begin: Callable[[], None]) -> float:
        """Begin a hang and wait for the next life; return how long until all was shown rightly."""
        return await self._after(begin, within_s=self.gateway.restart.noticed_s + 10.0)

    async def _after(self, end: Callable[[], None], *, within_s: float) -> float:
        lives, begun_s = len(self.gateway.lives), time.monotonic()
        end()
        await self.gateway.until_up(lives=lives + 1, within_s=within_s)
        await self.right(since_s=self.gateway.lives[-1].began_s)
        return time.monotonic() - begun_s

    async def check_line_timing(self, why: str) -> None:
        """Check that no starter waited longer than computed."""
        await self.check_gap(self.gaps.regular_s, why)

    async def check_gap(self, computed_s: float, why: str) -> None:
        """Check the longest time since the mark that any starter had to wait for a request."""
        starters = (await self.report())["starters"].values()
        gaps = [gap for each in starters for gap in each["gaps"]]
        fair_s = max(_fair_s(from_s, to_s) for from_s, to_s in gaps)
        longest_s = max(to_s - from_s for from_s, to_s in gaps)
        self.measurements |= {"gap s": round(longest_s, 2), "computed s": round(computed_s, 2)}
        if longest_s > computed_s:
            self.measurements["of the gateway s"] = round(fair_s, 2)
        self.check(fair_s <= computed_s, f"{why}: {fair_s:.2f} s")

    async def rate(self, seconds: float) -> Rate:
        """Return how many requests a second the line carries."""
        before = sum(each["requests"] for each in (await self.report())["starters"].values())
        begun_s = time.monotonic()
        await asyncio.sleep(seconds)
        after = sum(each["requests"] for each in (await self.report())["starters"].values())
        took_s = time.monotonic() - begun_s
        return Rate((after - before) / took_s, MACHINE.held_s(begun_s) / took_s)

    def check_rates(self, before: Rate, during: Rate, *, tolerance: float) -> None:
        """Check that the line was asked as often as before, but for what the machine took."""
        self.measurements |= {"polls/s before": round(before.per_s, 2), "during": round(during.per_s, 2)}
        ratio = during.per_s / before.per_s
        is_same = 1 - tolerance - during.held <= ratio <= 1 + tolerance + before.held
        self.check(is_same, f"the line's rate changed: {before} -> {during}")

    async def ready(self, starters: Iterable[str] = STARTERS) -> None:
        """Wait until starters stand still, and the present gateway says so and knows who they are."""
        began_s = self.gateway.lives[-1].began_s
        for starter in starters:
            wanted = {"state": "ready", "quality": "good"}
            await self.recorder.until(f"starter/{starter}/state", since_s=began_s, within_s=60.0, **wanted)
            await self._identified(starter, since_s=began_s)

    async def _identified(self, starter: str, *, since_s: float) -> None:
        """Wait until a gateway that began then knows who answers: before that it refuses starts."""
        topic = f"starter/{starter}/info"

        def is_known() -> bool:
            is_new = self.recorder.received_s.get(topic, 0.0) >= since_s
            return is_new and bool(self.recorder.latest[topic].get("firmware"))

        await until(is_known, f"{starter} is identified", within_s=60.0)

    async def settled(self) -> None:
        """Wait until nothing that was sent before can be written any more.

        Each starter's commands are taken in their order, one at a time: so a read that was sent after all
        others is carried out after them.
        """
        for starter, parameter in READABLE.items():
            for _ in range(SETTLED_TRIES):
                self.ids += 1
                self.recorder.command(starter, "read", f"{SETTLING}{self.ids}", parameter=parameter)
                final = await self.recorder.final(f"{SETTLING}{self.ids}")
                if final["code"] not in NOT_NOW:
                    break
                await asyncio.sleep(PACE_S)
            self.check(final["phase"] == "confirmed", f"a read of {starter} ended as {final}")

    async def starts(self) -> dict[str, int]:
        """Return how many start frames each starter has received."""
        return {name: each["start_frames"] for name, each in (await self.report())["starters"].items()}

    async def written(self, starter: str, *, since_s: float) -> Counter[str]:
        """Return what was written to a starter since then."""
        return Counter(pdu for _, pdu in await self._writes(starter, since_s))

    async def stop(self, starter: str, *, within_s: float = 10.0, id_: str = "") -> None:
        """Command a stop; check that its first frame comes within the bound and that the motor obeys."""
        sent_s = time.monotonic()
        self.recorder.publish(f"command/{starter}/alice/stop", {"id": id_} if id_ else "")
        while True:
            times_s = [at_s for at_s, _ in await self._writes(starter, sent_s)]
            if times_s:
                break
            if time.monotonic() - sent_s - MACHINE.held_s(sent_s) > within_s:
                self.check(False, f"a stop of {starter} reached no starter within {within_s:g} s")
                return
            await asyncio.sleep(0.02)
        self.stops_s.append(_fair_s(sent_s, times_s[0]))

    async def _writes(self, starter: str, since_s: float) -> list[tuple[float, str]]:
        answer = await self.starters.order("written", starter=starter, since_s=since_s)
        return [(at_s, pdu) for at_s, pdu in answer["writes"]]

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

    async def report(self, **options: Any) -> dict[str, Any]:
        """Return what the starters have lived through since the mark."""
        return await self.starters.order("report", **options)

    async def right(self, *, since_s: float, within_s: float = RIGHT_WITHIN_S) -> float:
        """Wait until all states are published as they are, in messages from after `since_s`; return how long.

        Take `since_s` from before whatever makes the gateway speak: it may be quicker than we are.
        """
        begun_s, end_s = time.monotonic(), MACHINE.fair_s() + within_s
        expected = {name: each["is_on"] for name, each in (await self.report())["starters"].items()}
        try:
            for starter, is_on in expected.items():
                states = ("running", "starting") if is_on else ("ready", "stopping", "not_ready")
                await self._state(starter, states, since_s=since_s, within_s=end_s - MACHINE.fair_s())
        except TimeoutError as error:
            self.check(False, f"state not right within {within_s:g} s: {error}")
        return time.monotonic() - begun_s

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

    async def calm(self) -> None:
        """Wait until no starter is polled faster than usual."""

        def is_calm() -> bool:
            states = [self.recorder.latest.get(f"starter/{name}/state", {}) for name in STARTERS]
            return all(each.get("state") in ("ready", "running") for each in states)

        await until(is_calm, "all motors stand or run", within_s=60.0)
        await asyncio.sleep(QUIET_S)

    async def right_still(self) -> None:
        """Check that all states are shown as they are; the last message may be from before."""
        await self.right(since_s=0.0)

    async def _state(self, starter: str, states: tuple[str, ...], *, since_s: float, within_s: float) -> None:
        topic = f"starter/{starter}/state"

        def is_right() -> bool:
            shown = self.recorder.latest.get(topic, {})
            is_new = self.recorder.received_s.get(topic, 0.0) >= since_s
            return is_new and shown.get("quality") == "good" and shown.get("state") in states

        try:
            await until(is_right, f"{starter} is {states[0]}", within_s=max(within_s, 0.0))
        except TimeoutError as error:
            raise TimeoutError(f"{error}, but {self.recorder.latest.get(topic)}") from error

    def sample(self) -> Usage:
        """Look at the gateway's process."""
        taken = usage(self.gateway.pid)
        self.samples.append((taken, open_files(self.gateway.pid)))
        return taken


def _fair_s(from_s: float, to_s: float) -> float:
    """Return how long something took without the machine's part; nothing when that was most of it."""
    is_unusable = MACHINE.is_unusable(from_s, to_s)
    return 0.0 if is_unusable else to_s - from_s - MACHINE.held_s(from_s, to_s)


@asynccontextmanager
async def world(
    folder: Path,
    restart: Restart,
    *,
    outlasts_hang: bool = False,
    deaf_after_s: float = 15.0,
    is_persistent: bool = False,
    state_dir: Path | None = None,
    module: str = "gateway",
    mqtt: str = "auto",
    seed: int = 0,
) -> AsyncIterator[World]:
    """Set everything up, wait until all is well, and give it to a scenario."""
    MACHINE.start()
    state_dir = state_dir or folder / "state"
    for each in (folder, state_dir):
        os.makedirs(each, exist_ok=True)
    broker = MosquittoBroker(folder / "broker", is_persistent=is_persistent)
    broker.start()
    config = folder / "site.toml"
    place: dict[str, Any] = {"deaf_after_s": deaf_after_s, "state_dir": state_dir, "mqtt": mqtt}
    config.write_text(site(folder, broker.port, **place), "utf-8")
    gaps = computed(config, restart)
    watchdog_s = math.ceil(WIDE_FACTOR * (gaps.hang_s if outlasts_hang else gaps.crash_s))
    config.write_text(site(folder, broker.port, **place, watchdog_s=watchdog_s), "utf-8")
    starters = Starters(config, watchdog_s)
    recorder = Recorder(broker.port)
    gateway = Supervisor.of_gateway(config, restart, module=module)
    here = World(
        folder, state_dir, broker, starters, gateway, recorder, gaps, watchdog_s, random.Random(seed)
    )
    here.measurements["watchdog_s"] = watchdog_s
    try:
        await starters.start()
        recorder.start()
        gateway.start()
        await gateway.until_up()
        await here.right(since_s=0.0, within_s=15.0)
        await asyncio.sleep(1.0)
        await starters.order("mark")
        yield here
    finally:
        await gateway.stop()
        recorder.stop()
        await starters.stop()
        broker.kill()
