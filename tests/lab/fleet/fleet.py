"""A fleet on one machine: gateways, the site's broker, its bridge over a link, the central broker."""

from __future__ import annotations

import asyncio
import os
import signal
import time
from collections import Counter
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path

from tests.lab.fleet.books import Received, Verdict, differing, verdict
from tests.lab.fleet.processes import Box
from tests.lab.fleet.site import BASE, CENTRAL, ROOM, SITE, edge, gateway_name, site_text, starter_names
from tests.lab.fleet.subscriber import Subscriber, retained
from tests.lab.usage import Usage, usage
from tests.mosquitto import MosquittoBroker
from tests.relay import Relay

PATIENCE_S = 180.0  # until all starters are ready
QUIET_S = 30.0  # so long nothing of a backlog comes any more: the rest is lost
STARTS_PER_S = 4.0  # of each gateway: more would wait for the line


@dataclass(frozen=True)
class FleetPlan:
    """How much of it."""

    gateways: int = 2
    starters: int = 4
    seconds: float = 10.0  # of each measured span, and of the cut
    room: int = ROOM  # messages that the site's broker stores for the bridge while the link is cut


@dataclass(frozen=True)
class MeasuredSpan:
    """What went through in a span of time, and what it took."""

    name: str
    seconds: float
    published: int  # messages at the site's broker
    size: int  # their bytes as MQTT packets
    arrived: int  # messages at the central broker
    kinds: Counter[str]  # what was published: gateway/fresh, state, value ..
    used: dict[str, Usage]  # by kind of process: processor time of the span, memory at its end
    load: float  # of the machine, all that runs on it


@dataclass
class FleetResult:
    """What a run found."""

    plan: FleetPlan
    spans: list[MeasuredSpan] = field(default_factory=list)
    start_up: dict[str, tuple[int, int]] = field(
        default_factory=dict
    )  # by gateway: messages, in the worst second
    starts: Counter[str] = field(default_factory=Counter)  # ends of the commands that came over the bridge
    cut: dict[str, float] = field(default_factory=dict)
    exits: list[int] = field(default_factory=list)  # of the gateways, the killed one first
    verdict: Verdict | None = None
    retained: dict[str, bytes] = field(default_factory=dict)  # at the central broker
    differing: list[str] = field(default_factory=list)  # topics that are not retained alike at the site's

    @property
    def is_whole(self) -> bool:
        """Return whether nothing was lost, and both brokers hold the same at the end."""
        return self.verdict is not None and self.verdict.is_whole and not self.differing


async def run_fleet(plan: FleetPlan, folder: Path) -> FleetResult:
    """Run it: start-up, all motors at a standstill, all running, a cut with a kill and a restart, the end."""
    async with fleet(plan, folder) as it:
        await it.start_up()
        await it.measure("standing")
        await it.start_motors()
        await it.measure("running")
        await it.cut_and_restart()
        await it.end()
        return it.result


class Fleet:
    """All of it while it runs."""

    def __init__(
        self,
        plan: FleetPlan,
        boxes: list[Box],
        brokers: dict[str, MosquittoBroker],
        link: Relay,
        counters: dict[str, Subscriber],
    ) -> None:
        self.result = FleetResult(plan)
        self._plan = plan
        self._boxes = boxes
        self._brokers = brokers
        self._link = link
        self._counters = counters

    async def start_up(self) -> None:
        """Start all gateways at once and wait until every starter is ready."""
        begun_s = time.monotonic()
        await asyncio.gather(*(box.start() for box in self._boxes))
        wanted = {f"{box.name}/{name}" for box in self._boxes for name in starter_names(self._plan.starters)}
        await self._until(lambda: wanted <= self._counters["central"].ready, "all starters are ready")
        await asyncio.sleep(min(self._plan.seconds, 5.0))
        found = self._counters["site"].between(begun_s, time.monotonic())
        for box in self._boxes:
            of_box = [each for each in found if each.gateway == box.name]
            worst = Counter(int(each.at_s) for each in of_box).most_common(1)
            self.result.start_up[box.name] = (len(of_box), worst[0][1])

    async def measure(self, name: str) -> None:
        """Let the time of a span pass."""
        before, begun_s = self._used(), time.monotonic()
        await asyncio.sleep(self._plan.seconds)
        ended_s, after = time.monotonic(), self._used()
        site, central = (self._counters[each].between(begun_s, ended_s) for each in ("site", "central"))
        used = {kind: Usage(after[kind].cpu_s - before[kind].cpu_s, after[kind].rss_kib) for kind in after}
        size, load = sum(each.size for each in site), os.getloadavg()[0]
        self.result.spans.append(
            MeasuredSpan(
                name, ended_s - begun_s, len(site), size, len(central), Counter(map(_kind, site)), used, load
            )
        )

    async def start_motors(self) -> None:
        """Start every motor by a command at the central broker."""
        central = self._counters["central"]
        for starter in starter_names(self._plan.starters):
            for box in self._boxes:
                central.command(box.name, starter, "start")
            await asyncio.sleep(1 / STARTS_PER_S)
        wanted = len(self._boxes) * self._plan.starters
        await self._until(lambda: central.ends.total() >= wanted, "every start has its result")
        self.result.starts = Counter(central.ends)

    async def cut_and_restart(self) -> None:
        """Cut the link, kill one gateway and restart another, then join it and wait for the backlog."""
        site, central = self._counters["site"], self._counters["central"]
        before, begun_s = self._used(), time.monotonic()
        self._link.cut()
        await asyncio.sleep(self._plan.seconds / 3)
        self.result.exits.append(await self._boxes[0].restart(signal.SIGKILL))
        self.result.exits.append(await self._boxes[-1].restart(signal.SIGTERM))
        await asyncio.sleep(max(begun_s + self._plan.seconds - time.monotonic(), 1.0))
        backlog, memory = len(site.between(begun_s, time.monotonic())), self._used()
        joined_s = time.monotonic()
        await self._link.join()
        await self._passed(joined_s)
        passed_s = central.reached_s(site, joined_s)
        self.result.cut = {
            "seconds": joined_s - begun_s,
            "messages": backlog,
            "broker_kib": memory["site's broker"].rss_kib - before["site's broker"].rss_kib,
            "first_s": min((each.at_s for each in central.between(joined_s, passed_s)), default=joined_s)
            - joined_s,
            "passed_s": passed_s - joined_s,
            "arrived": len(central.between(joined_s, passed_s)),
            "copies": central.most_copies(joined_s),
        }
        await asyncio.sleep(1.0)

    async def end(self) -> None:
        """End all gateways in order, and compare the books."""
        self.result.exits += await asyncio.gather(*(box.end(signal.SIGTERM) for box in self._boxes))
        site, central = self._counters["site"], self._counters["central"]
        ended_s = time.monotonic()
        await self._passed(ended_s)
        await asyncio.sleep(1.0)
        self.result.verdict = verdict(site.taken, central.taken)
        await self._compare_retained()

    def _used(self) -> dict[str, Usage]:
        pids = [box.pids for box in self._boxes]
        return {
            "site's broker": usage(self._brokers["site"].pid),
            "central broker": usage(self._brokers["central"].pid),
            "gateways": sum((usage(gateway) for gateway, _ in pids), Usage(0.0, 0)),
            "simulators": sum((usage(simulator) for _, simulator in pids), Usage(0.0, 0)),
            "counters and link": usage(os.getpid()),
        }

    async def _compare_retained(self) -> None:
        """Note what the central broker retains, once it is what the site's does, or after a while."""
        here = await asyncio.to_thread(retained, self._brokers["site"].port, BASE)
        end_s = time.monotonic() + QUIET_S
        while True:
            there = await asyncio.to_thread(retained, self._brokers["central"].port, f"{SITE}{BASE}")
            self.result.retained, self.result.differing = there, differing(here, there, prefix=SITE)
            if not self.result.differing or time.monotonic() > end_s:
                return

    async def _passed(self, until_s: float) -> None:
        """Wait until all that the site's broker had until then is at the central one, or the rest is lost."""
        least, since_s = -1, time.monotonic()
        while missing := self._counters["central"].missing_of(self._counters["site"], until_s):
            if missing < least or least < 0:
                least, since_s = missing, time.monotonic()
            elif time.monotonic() > since_s + QUIET_S:
                return  # the verdict says what
            await asyncio.sleep(0.2)

    async def _until(self, is_so: Callable[[], bool], what: str) -> None:
        end_s = time.monotonic() + PATIENCE_S
        while not is_so():
            if time.monotonic() > end_s:
                logs = "\n".join(box.output()[-2000:] for box in self._boxes)
                raise TimeoutError(f"never: {what}\n{logs}")
            await asyncio.sleep(0.2)


def _kind(message: Received) -> str:
    _, _, branch, *rest = message.topic.split("/")
    return f"{branch}/{rest[0]}" if branch == "gateway" else rest[1] if branch == "starter" else branch


@asynccontextmanager
async def fleet(plan: FleetPlan, folder: Path) -> AsyncIterator[Fleet]:
    """Give a fleet whose simulators, brokers and counters run, and whose gateways do not yet."""
    async with AsyncExitStack() as stack:
        central = MosquittoBroker(folder / "central", options=CENTRAL)
        central.start()
        stack.callback(central.kill)
        link = await stack.enter_async_context(Relay(central.port))
        site = MosquittoBroker(folder / "site", is_persistent=True, options=edge(link.port, room=plan.room))
        site.start()
        stack.callback(site.kill)
        counters = {
            "site": stack.enter_context(Subscriber(site.port, base=BASE)),
            "central": stack.enter_context(Subscriber(central.port, base=BASE, prefix=SITE)),
        }
        boxes = []
        for number in range(plan.gateways):
            config = folder / f"{gateway_name(number)}.toml"
            config.write_text(site_text(folder, number, starters=plan.starters, edge_port=site.port), "utf-8")
            boxes.append(await stack.enter_async_context(Box(gateway_name(number), config)))
        yield Fleet(plan, boxes, {"site": site, "central": central}, link, counters)
