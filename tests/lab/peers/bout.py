"""One contender, one fault: a line, a broker, a consumer and a service of their own, and what came of it."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from tests.lab.peers.contenders import STARTERS, WATCHDOG_S, Contender, PeerSite, nothing_good
from tests.lab.peers.measure import CURRENT, StarterBook, longest_old_s, longest_stall_s, lost, wrong
from tests.lab.peers.recorder import PeerRecorder
from tests.lab.torture.process import Starters
from tests.lab.torture.supervisor import Supervisor, restart_of_unit
from tests.lab.torture.waiting import until
from tests.mosquitto import MosquittoBroker

EVERY_S = 1.0
UP_WITHIN_S = 30.0
WARM_S = 4.0
START_FRAME, STOP_FRAME = "050064ff00", "0500640000"  # coil 100
STILL_SENDING = "a unit was still sending"  # of a collision: the other kind is a reply into a request


@dataclass
class Score:
    """What was measured in one bout."""

    lost: int = 0
    possible: int = 0
    stall_s: float = 0.0
    trips: int = 0
    wrong: list[str] = field(default_factory=list)
    old_s: float = 0.0
    stale_starts: int | None = None  # None: none was ordered
    too_soon: int = 0  # requests before t3.5, or into a reply
    crossed: int = 0  # requests into which a late reply came
    stops_s: list[float | None] = field(default_factory=list)  # None: never on the wire
    deaths: int = 0  # of the contender, by itself
    late: int = 0  # how often the starters themselves had no processor time
    unreadable: list[str] = field(default_factory=list)


@dataclass
class Bout:
    """What a fault may touch."""

    folder: Path
    broker: MosquittoBroker
    starters: Starters
    service: Supervisor
    recorder: PeerRecorder
    away: dict[str, list[tuple[float, float]]] = field(default_factory=dict)  # the line was cut
    stops_s: list[float | None] = field(default_factory=list)
    kills: int = 0
    marked_s: float = 0.0
    stale_after_s: float | None = None  # a start on the wire from then on is stale

    def stop_broker(self) -> None:
        """Stop it in order: sessions and retained messages are stored."""
        self.broker.stop()
        self.recorder.published.extend(
            nothing_good(time.monotonic())
        )  # the consumer knows that it receives nothing

    def wipe_broker(self) -> None:
        """Kill it and lose everything that it knew."""
        self.broker.kill()
        self.recorder.published.extend(nothing_good(time.monotonic()))
        for path in (self.folder / "broker").glob("mosquitto.db*"):
            path.unlink()

    async def writes(self, starter: str, frame: str, since_s: float) -> list[float]:
        """Return when such frames have reached a starter since then."""
        account = await self.starters.order("account")
        writes = account["starters"][starter]["writes"]
        return [at_s for at_s, pdu in writes if pdu == frame and at_s >= since_s]

    async def score(self) -> Score:
        """Return what has come of it since the mark."""
        account, now_s = await self.starters.order("account"), time.monotonic()
        lived = account["starters"]
        books = {
            name: StarterBook(
                steps=[(at_s, amps) for at_s, amps in each["steps"]],
                running=[(at_s, is_on) for at_s, is_on in each["running"]],
                away=[*((begin_s, end_s) for begin_s, end_s in each["away"]), *self.away.get(name, ())],
                requests_s=each["requests_s"],
            )
            for name, each in lived.items()
        }
        published = list(self.recorder.published)
        missing, possible = lost(books, published, self.marked_s, now_s)
        return Score(
            lost=missing,
            possible=possible,
            stall_s=longest_stall_s(books, self.marked_s, now_s),
            trips=sum(at_s >= self.marked_s for each in lived.values() for at_s in each["trips_s"]),
            wrong=[f"{t.starter} {t.point} {t.value}" for t in wrong(books, published, self.marked_s)],
            old_s=longest_old_s(books, published, self.marked_s, now_s),
            stale_starts=await self._stale_starts(),
            too_soon=sum(
                kind == "early" or detail == STILL_SENDING for kind, detail in account["violations"]
            ),
            crossed=sum(
                kind == "collision" and detail != STILL_SENDING for kind, detail in account["violations"]
            ),
            stops_s=self.stops_s,
            deaths=len(self.service.lives) - 1 - self.kills,
            late=account["late"],
            unreadable=self.recorder.bad[:3],
        )

    async def _stale_starts(self) -> int | None:
        if self.stale_after_s is None:
            return None
        return sum([len(await self.writes(name, START_FRAME, self.stale_after_s)) for name in STARTERS])


@asynccontextmanager
async def bout(contender: Contender, *, every_s: float = EVERY_S) -> AsyncIterator[Bout]:
    """Set everything up, wait until all four currents are published, and judge from then on."""
    name = contender.name.split()[0].strip(",")
    with TemporaryDirectory(prefix=f"peers-{name}-", ignore_cleanup_errors=True) as folder:
        async with _bout(Path(folder), contender, every_s) as here:
            yield here


@asynccontextmanager
async def _bout(folder: Path, contender: Contender, every_s: float) -> AsyncIterator[Bout]:
    broker = MosquittoBroker(folder / "broker", is_persistent=True)
    site = PeerSite(folder, broker.port)
    starters = Starters(site.configure(every_s), WATCHDOG_S, module="tests.lab.peers.plant")
    recorder = PeerRecorder(broker.port, contender)
    command, environ = contender.command(site, every_s), contender.environ(site)
    service = Supervisor(command, restart_of_unit(), folder, environ)
    here = Bout(folder, broker, starters, service, recorder)
    async with AsyncExitStack() as stack:
        stack.callback(broker.kill)
        broker.start()
        stack.push_async_callback(starters.stop)
        await starters.start()
        await starters.order("run")
        stack.callback(recorder.stop)
        recorder.start()
        stack.push_async_callback(service.stop)
        service.start()
        await until(lambda: _are_all_published(recorder), "all four are published", within_s=UP_WITHIN_S)
        await asyncio.sleep(WARM_S)
        await starters.order("mark")
        here.marked_s = time.monotonic()
        yield here


def _are_all_published(recorder: PeerRecorder) -> bool:
    published: list[Any] = list(recorder.published)
    return {each.starter for each in published if each.point == CURRENT and each.value is not None} == set(
        STARTERS
    )
