"""SIGKILL of the whole gateway while motors start, at any moment, and around the moment of each record.

What is demanded of the motors' history after every kill: the file opens; a start that it had is there still,
once; it has no start that no motor has made; only a start whose record was under way may be missing. Of the
broker's clients: they receive each start that is stored, and none that is not; the published number of starts
never falls.
"""

from __future__ import annotations

import asyncio
import os
import random
import signal
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from gateway.app.history.starts import SUMMARIES
from gateway.history.start_record import StartSummary
from gateway.storage.history import FILE, read_history
from gateway.storage.history_table import HistoryRow
from tests.lab.torture.command_site import STARTERS, CommandSite, ResultListener
from tests.lab.torture.recorder import BASE
from tests.lab.torture.waiting import until

ANY, RECORD, AWAY = "at any moment", "around a record", "without a broker"
WAYS = (AWAY, RECORD, ANY, ANY)
LONGEST_S = 8.0  # a start with its record takes less
STEP_S = 0.001
AFTER_RECORD_S = 0.15  # the outbox is on the disk 0.2 s after it was put
EARLIEST_S, LATEST_S = -0.5, 4.0  # of the time in a record, against that of the motor's start
RECORD_S = 10.0  # from a start until its record is surely stored
UNSEEN_S = -2.5  # a kill so short before a start: its frame was on its way, the next life did not poll yet
SETTLED_S = 20.0
COUNT_THEMSELVES = ("mill",)  # an SSW900's own number of starts is published


class HistoryListener(ResultListener):
    """Receives starts and their number too."""

    def __init__(self, port: int) -> None:
        super().__init__(port)
        self.starts: list[tuple[str, dict[str, Any]]] = []
        self.counts: dict[str, list[int]] = {}

    def _connected(self, client: Any, *rest: Any) -> None:
        super()._connected(client, *rest)
        for topic in ("starter/+/start", "starter/+/value/starts_total", "gateway/event"):
            client.subscribe(f"{BASE}/{topic}", qos=1)

    def _book(self, topic: str, body: dict[str, Any]) -> None:
        super()._book(topic, body)
        parts = topic.split("/")
        if parts[0] == "starter" and parts[2] == "start":
            self.starts.append((parts[1], body))
        elif parts[-1] == "starts_total" and body.get("value") is not None:
            counts = self.counts.setdefault(parts[1], [])
            if counts[-1:] != [body["value"]]:
                counts.append(body["value"])


@dataclass
class TrueStarts:
    """What the motors have done, and when the gateway was killed; times are UTC."""

    site: CommandSite
    starts: dict[str, list[float]] = field(default_factory=lambda: {name: [] for name in STARTERS})
    kills_s: list[float] = field(default_factory=list)
    stored: dict[str, list[str]] = field(default_factory=lambda: {name: [] for name in STARTERS})

    def note(self) -> None:
        """Note the starts since the last time."""
        for name, ear in self.site.ears.items():
            if ear.unit.motor.starts > len(self.starts[name]):
                self.starts[name].append(time.time())

    def rows(self, name: str) -> list[HistoryRow]:
        """Return what the file has of a starter; it must open."""
        return read_history(self.site.gateway.config.parent / "state", name)

    def look(self, what: str) -> None:
        """Check that every start that was stored once is stored still, in its order."""
        for name in STARTERS:
            ids = [row.id for row in self.rows(name) if row.kind == "start"]
            before, self.stored[name] = self.stored[name], ids
            self.site.check(ids[: len(before)] == before, f"{what}: {name} had {before[-3:]}, has {ids[-3:]}")
            self.site.check(len(set(ids)) == len(ids), f"{what}: {name} has a start twice")


async def history_kills(site: CommandSite, count: int, seed: int) -> None:
    """Kill so many times and judge."""
    dice = random.Random(seed)
    true = TrueStarts(site)
    ways: Counter[str] = Counter()
    watching = asyncio.create_task(_watch(true))
    for number in range(count):
        way = WAYS[number % len(WAYS)]
        ways[way] += 1
        await _start_and_kill(site, true, dice, way=way, number=number)
        true.look(f"kill {number}, {way}")
    await _settled(site, true)
    watching.cancel()
    for name in STARTERS:
        _judge(site, true, name)
    lost = [each for each in site.listener.events if each["code"].endswith("_lost")]
    site.check(not lost, f"a file was lost: {lost}")
    site.measurements |= dict(sorted(ways.items()))


async def _start_and_kill(
    site: CommandSite, true: TrueStarts, dice: random.Random, *, way: str, number: int
) -> None:
    """Let some motors start, by a command or at the motor, and kill the gateway meanwhile."""
    await site.ready()
    chosen = dice.sample(STARTERS, dice.randint(1, len(STARTERS)))
    commanded = [] if way == AWAY else [name for name in chosen if dice.random() < 0.5]
    if way == AWAY:
        site.broker.stop()
    for name in chosen:
        if name in commanded:
            site.listener.command(name, "start", f"kill-{number}")
        else:
            _at_the_motor(site, name).start()
        await asyncio.sleep(dice.uniform(0.0, 0.5))
    await _moment(site, dice, way)
    lives = len(site.gateway.lives)
    site.gateway.signal(signal.SIGKILL)
    true.kills_s.append(time.time())
    await until(lambda: site.gateway.lives[lives - 1].ended_s is not None, "it is dead", within_s=5.0)
    if way == AWAY:
        site.broker.start()
    for name in set(STARTERS) - set(commanded):
        _at_the_motor(site, name).stop()
    await site.gateway.until_up(lives=lives + 1)
    began_s = site.gateway.lives[-1].began_s
    await site.listener.until("gateway/status", since_s=began_s, within_s=20.0, state="online")
    for name in commanded:
        if site.ears[name].unit.motor.is_turned_on:
            await site.stop(name)


def _at_the_motor(site: CommandSite, name: str) -> Any:
    """Return a motor as it is now."""
    unit = site.ears[name].unit
    unit.advance(asyncio.get_running_loop().time())
    return unit.motor


async def _watch(true: TrueStarts) -> None:
    """Note when motors start, until cancelled."""
    while True:
        true.note()
        await asyncio.sleep(0.005)


async def _moment(site: CommandSite, dice: random.Random, way: str) -> None:
    """Return when the gateway is to be killed."""
    if way == ANY:
        await asyncio.sleep(dice.uniform(0.0, LONGEST_S))
        return
    log = site.gateway.config.parent / "state" / f"{FILE}-wal"
    await asyncio.sleep(3.0)  # marks of earlier starts may go meanwhile
    before = _size_and_time(log)
    for _ in range(int(LONGEST_S / STEP_S)):
        if _size_and_time(log) != before:
            break
        await asyncio.sleep(STEP_S)
    await asyncio.sleep(dice.uniform(0.0, AFTER_RECORD_S))


def _size_and_time(path: Path) -> tuple[int, int]:
    try:
        status = os.stat(path)
    except OSError:
        return 0, 0
    return status.st_size, status.st_mtime_ns


async def _settled(site: CommandSite, true: TrueStarts) -> None:
    """Let the last life record a start of each motor, and wait until all that is stored is published."""
    listener = site.listener
    assert isinstance(listener, HistoryListener)
    await site.ready()
    for name in STARTERS:
        _at_the_motor(site, name).start()
    true.note()
    before = {name: len(true.stored[name]) for name in STARTERS}

    def is_recorded() -> bool:
        true.look("at the end")
        return all(len(true.stored[name]) > before[name] for name in STARTERS)

    await until(is_recorded, "the last starts are recorded", within_s=2 * RECORD_S)

    def is_published() -> bool:
        ids = {body["id"] for _, body in list(listener.starts)}
        counts = {name: listener.counts.get(name, [])[-1:] for name in STARTERS}
        return all(
            ids.issuperset(stored) and (name in COUNT_THEMSELVES or counts[name] == [len(stored)])
            for name, stored in true.stored.items()
        )

    try:
        await until(is_published, "all that is stored is published", within_s=SETTLED_S)
    except TimeoutError as error:
        site.check(False, str(error))


def _judge(site: CommandSite, true: TrueStarts, name: str) -> None:
    """Compare what was stored, what was published, and what the motor has done."""
    listener = site.listener
    assert isinstance(listener, HistoryListener)
    rows = true.rows(name)
    starts = [StartSummary.from_dict(row.data) for row in rows if row.kind == "start"]
    real, cut = list(true.starts[name]), 0
    for start in starts:
        fitting = [at_s for at_s in real if EARLIEST_S < start.time_s - at_s < LATEST_S]
        site.check(bool(fitting), f"{name}: no motor has made the start {start.id} at {start.time_s}")
        real = [at_s for at_s in real if at_s not in fitting[:1]]
    for at_s in real:
        after_s = [round(kill_s - at_s, 1) for kill_s in true.kills_s]
        was_cut = any(UNSEEN_S < each < RECORD_S for each in after_s)
        site.check(was_cut, f"{name}: a start is not stored, kills came {after_s[-5:]} s after it")
        cut += was_cut
    counted = [row.data["totals"]["starts"] for row in rows if row.kind == "counters"]
    months = sum(sum(row.data["outcomes"].values()) for row in rows if row.kind == "month")
    site.check(len(starts) < SUMMARIES, "too many to compare")
    site.check(sum(counted) == months == len(starts), f"{name}: {counted}, {months}, {len(starts)} starts")
    published = [body for each, body in listener.starts if each == name]
    by_id = {body["id"]: body for body in published}
    site.check(all(by_id[body["id"]] == body for body in published), f"{name}: two starts have one id")
    invented = by_id.keys() - {start.id for start in starts}
    site.check(not invented, f"{name}: published, but not stored: {sorted(invented)}")
    counts = listener.counts.get(name, [])
    site.check(counts == sorted(counts), f"{name}: the number of starts fell: {counts}")
    if name not in COUNT_THEMSELVES:
        site.check(counts[-1:] == [len(starts)], f"{name}: published {counts[-1:]} of {len(starts)}")
    for what, value in (("stored", len(starts)), ("cut", cut), ("repeated", len(published) - len(by_id))):
        site.measurements[what] = site.measurements.get(what, 0) + value
