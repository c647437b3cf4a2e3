"""Everything under test, with real processes: broker, starters, supervisor and gateway, recorder."""

from __future__ import annotations

import asyncio
import json
import math
import os
import random
import signal
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from gateway.commands.failure_gaps import gaps_of_starter
from gateway.config.load import load
from gateway.config.prospects import prospects_of
from gateway.line.gaps import WIDE_FACTOR, Gaps, Restart
from tests.mosquitto import MosquittoBroker
from tests.torture.process import Sample, Starters, sample
from tests.torture.recorder import Recorder
from tests.torture.supervisor import Supervisor
from tests.torture.waiting import until

STARTERS = {"pump": "ssw07", "fan": "ssw06", "mill": "ssw900", "belt": "sst"}
KEEPALIVE_S = 5
RIGHT_WITHIN_S = 5.0  # after a recovery
QUIET_S = 4.0  # what is asked after a change has been asked by then
STOP_WITHIN_S = 1.0  # over MQTT, beside what the line needs
START_TRIES = 3


def site(folder: Path, broker_port: int, *, deaf_after_s: float, state_dir: Path, watchdog_s: int = 0) -> str:
    """Return the configuration of one line with a starter of each family."""
    starters = "".join(
        f'\n[[line.starter]]\nname = "{name}"\naddress = {address}\nfamily = "{family}"\nevery_s = 1.0\n'
        f"watchdog_s = {watchdog_s}\n"
        for address, (name, family) in enumerate(STARTERS.items(), 1)
    )
    return (
        f'[gateway]\nname = "plant"\nstate_dir = "{state_dir}"\n\n'
        f'[mqtt]\nurl = "mqtt://127.0.0.1:{broker_port}"\nkeepalive_s = {KEEPALIVE_S}\n\n'
        f'[[line]]\nname = "hall"\nport = "{folder}/ttyHALL"\nbaud = 19200\nframing = "8N2"\n'
        f"deaf_after_s = {deaf_after_s}\n{starters}"
        '\n[[operator]]\nclient = "alice"\nmay = ["*"]\nstarters = ["*"]\n'
    )


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
    dice: random.Random
    commanded: dict[str, int] = field(default_factory=lambda: dict.fromkeys(STARTERS, 0))
    failures: list[str] = field(default_factory=list)
    figures: dict[str, Any] = field(default_factory=dict)
    stops_s: list[float] = field(default_factory=list)  # from publishing to the frame on the line
    ids: int = 0
    samples: list[Sample] = field(default_factory=list)

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
        for _ in range(START_TRIES):
            result = await self.recorder.final(self.begin_start(starter))
            if result["phase"] != "rejected":
                break
            await asyncio.sleep(1.0)  # on a busy machine a starter may seem not to answer
        self.check(result["phase"] == "confirmed", f"a start of {starter} ended as {result}")

    async def after_death(self, number: signal.Signals, *, within_s: float = 10.0) -> float:
        """Send a deadly signal and wait for the next life; return how long until all was shown rightly."""
        lives, begun_s = len(self.gateway.lives), time.monotonic()
        self.gateway.signal(number)
        await self.gateway.until_up(lives=lives + 1, within_s=within_s)
        ready_s = time.monotonic()
        await self.right(since_s=ready_s - 0.5)
        return time.monotonic() - begun_s

    async def check_line_kept_time(self, why: str) -> None:
        """Check that nobody waited longer than computed, unless the starters themselves were late."""
        report = await self.report()
        gap_s = max(each["longest_gap_s"] for each in report["starters"].values())
        self.figures |= {"gap s": round(gap_s, 3), "computed s": round(self.gaps.regular_s, 2)}
        if report["late"]:
            self.figures["starters late"] = report["late"]
        self.check(gap_s <= self.gaps.regular_s or report["late"] > 0, why)

    async def longest_gap_s(self) -> float:
        """Return the longest time since the mark that any starter had to wait for a request."""
        starters = (await self.report())["starters"].values()
        return round(max(each["longest_gap_s"] for each in starters), 3)

    async def rate(self, seconds: float) -> float:
        """Return how many requests a second the line carries."""
        before = sum(each["heard"] for each in (await self.report())["starters"].values())
        begun_s = time.monotonic()
        await asyncio.sleep(seconds)
        after = sum(each["heard"] for each in (await self.report())["starters"].values())
        return (after - before) / (time.monotonic() - begun_s)

    async def stop(self, starter: str, *, within_s: float = 10.0) -> None:
        """Command a stop; check that its first frame comes within the bound and that the motor obeys."""
        sent_s = time.monotonic()
        self.recorder.publish(f"command/{starter}/alice/stop", "")
        while True:
            report = await self.report()
            times_s = [at_s for at_s, _ in report["starters"][starter]["writes"] if at_s >= sent_s]
            if times_s:
                break
            if time.monotonic() - sent_s > within_s:
                self.check(False, f"a stop of {starter} reached no starter within {within_s:g} s")
                return
            await asyncio.sleep(0.02)
        self.stops_s.append(times_s[0] - sent_s)

    async def report(self, **options: Any) -> dict[str, Any]:
        """Return what the starters have lived through since the mark."""
        return await self.starters.order("report", **options)

    async def right(self, *, since_s: float, within_s: float = RIGHT_WITHIN_S) -> float:
        """Wait until all states are told as they are, in messages from after `since_s`; return how long."""
        begun_s = time.monotonic()
        expected = {name: each["is_on"] for name, each in (await self.report())["starters"].items()}
        try:
            for starter, is_on in expected.items():
                states = ("running", "starting") if is_on else ("ready", "stopping", "not_ready")
                await self._state(starter, states, since_s=since_s, end_s=begun_s + within_s)
        except TimeoutError as error:
            self.check(False, f"state not right within {within_s:g} s: {error}")
        return time.monotonic() - since_s

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

    async def _state(self, starter: str, states: tuple[str, ...], *, since_s: float, end_s: float) -> None:
        topic = f"starter/{starter}/state"

        def is_right() -> bool:
            shown = self.recorder.latest.get(topic, {})
            is_new = self.recorder.received_s.get(topic, 0.0) >= since_s
            return is_new and shown.get("quality") == "good" and shown.get("state") in states

        try:
            await until(is_right, f"{starter} is {states[0]}", within_s=end_s - time.monotonic())
        except TimeoutError as error:
            raise TimeoutError(f"{error}, but {self.recorder.latest.get(topic)}") from error

    async def judge(self, *, may_trip: bool = False) -> None:
        """Check what must hold after every scenario."""
        report = await self.report(values=True)
        for name, each in report["starters"].items():
            self.check(may_trip or not each["trips"], f"{name}: watchdog tripped ({each['trips']})")
            frames, commanded = each["start_frames"], self.commanded[name]
            self.check(frames <= commanded, f"{name}: {frames} start frames for {commanded} commands")
        self.check(not report["violations"], f"line violations: {report['violations'][:3]}")
        self._judge_values(report["values"])
        finals = self.recorder.finals_of_ids()
        self.check(max(finals.values(), default=1) == 1, f"several final results: {finals.most_common(3)}")
        self.check(not self.recorder.bad, f"unreadable messages: {self.recorder.bad[:3]}")
        self.check("Traceback" not in self.gateway.log, "an unhandled exception is in the log")
        bound_s = STOP_WITHIN_S + self._stop_latency_s()
        self.check(max(self.stops_s, default=0.0) <= bound_s, f"a stop took {max(self.stops_s, default=0)} s")
        self._judge_samples()

    def sample(self) -> Sample:
        """Look at the gateway's process."""
        taken = sample(self.gateway.pid)
        self.samples.append(taken)
        return taken

    def _judge_values(self, values: dict[str, dict[str, list[Any]]]) -> None:
        true = {
            (name, point, json.dumps(value))
            for name, points in values.items()
            for point, seen in points.items()
            for value in seen
        }
        false = self.recorder.good - true
        self.figures["good values"] = len(self.recorder.good)
        self.check(not false, f"shown as good, never had: {sorted(false)[:3]}")

    def _judge_samples(self) -> None:
        if len(self.samples) < 2:
            return
        first, last = self.samples[0], self.samples[-1]
        self.check(last.files <= first.files + 1, f"file descriptors {first.files} -> {last.files}")
        self.check(last.threads <= first.threads + 1, f"threads {first.threads} -> {last.threads}")
        grown_kb = last.rss_kb - first.rss_kb
        self.check(grown_kb < 20_000, f"memory {first.rss_kb} -> {last.rss_kb} KB")

    def _stop_latency_s(self) -> float:
        figures = self.recorder.latest.get("gateway/line/hall", {})
        return float(figures.get("stop_latency_s", {}).get("computed", 1.0))


@asynccontextmanager
async def world(
    folder: Path,
    restart: Restart,
    *,
    outlasts_hang: bool = False,
    deaf_after_s: float = 15.0,
    is_persistent: bool = False,
    state_dir: Path | None = None,
    stderr: int | None = None,
    seed: int = 0,
) -> AsyncIterator[World]:
    """Set everything up, wait until all is well, and give it to a scenario."""
    state_dir = state_dir or folder / "state"
    for each in (folder, state_dir):
        os.makedirs(each, exist_ok=True)
    broker = MosquittoBroker(folder / "broker", is_persistent=is_persistent)
    broker.start()
    config = folder / "site.toml"
    place: dict[str, Any] = {"deaf_after_s": deaf_after_s, "state_dir": state_dir}
    config.write_text(site(folder, broker.port, **place), "utf-8")
    gaps = _computed(config, restart)
    watchdog_s = math.ceil(WIDE_FACTOR * (gaps.hang_s if outlasts_hang else gaps.crash_s))
    config.write_text(site(folder, broker.port, **place, watchdog_s=watchdog_s), "utf-8")
    starters = Starters(config, watchdog_s)
    recorder = Recorder(broker.port)
    gateway = Supervisor(config, restart, folder, stderr)
    here = World(folder, state_dir, broker, starters, gateway, recorder, gaps, random.Random(seed))
    here.figures["watchdog_s"] = watchdog_s
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


def _computed(config: Path, restart: Restart) -> Gaps:
    """Return the longest gaps of any starter of the only line."""
    (line,) = prospects_of(load(config))
    each = [gaps_of_starter(line, starter, restart) for starter in line.starters]
    return max(each, key=lambda gaps: gaps.hang_s)
