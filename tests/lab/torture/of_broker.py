"""The broker is away, killed, or takes the connection and says nothing."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable

from tests.lab.torture.machine import sleep_fairly, until
from tests.lab.torture.scenario import CRASH, Scenario
from tests.lab.torture.world import KEEPALIVE_S, RIGHT_WITHIN_S, STARTERS, World

LONGEST_RETRY_S = 4.0  # gateway.mqtt.connection.settings; only then is a broker that is back found
AGAIN_S = LONGEST_RETRY_S + RIGHT_WITHIN_S
SLOWEST_S = 10.0  # the period of the slowest polls: less than that is not one round
RATE_TOLERANCE = 0.02
FAULTS = 3
RECORDS_OF_A_FAULT = 12  # states and alarms that may overtake one another
LATEST_EVERY_S = 30.0  # a state that does not change is published so often
STORED_WITHIN_S = 1.0  # of an event: until then it is on the disk
QUIET_S = 3.0
SHORT_RATE_TOLERANCE = 0.1  # a few seconds are too few polls for two per cent


async def away(w: World, seconds: int) -> None:
    """Stop the broker in order; things happen at the starters meanwhile, and are published afterwards."""
    await w.calm()
    before = await w.rate(max(seconds, SLOWEST_S))
    books = w.recorder.books
    known, known_late = books.faults_of("mill"), books.published_late
    await asyncio.to_thread(w.broker.stop)
    begun_s, first_seq = time.monotonic(), max(w.recorder.seqs)
    during = await w.rate(max(seconds, SLOWEST_S))
    seen = sum([await w.fault("mill") for _ in range(FAULTS)])
    await _back(w, w.broker.start)
    await until(lambda: books.faults_of("mill") >= known + seen, "all faults are published", within_s=10.0)
    late = -1
    while late != books.published_late:  # until no history has come for a while
        late = books.published_late
        await sleep_fairly(QUIET_S)
    count = books.faults_of("mill") - known
    missing = set(range(first_seq, max(w.recorder.seqs))) - w.recorder.seqs
    again = len(STARTERS) * (1 + (time.monotonic() - begun_s) / LATEST_EVERY_S)
    overtaken = FAULTS * RECORDS_OF_A_FAULT + again
    w.row.measurements |= {"faults published": count, "values published late": late - known_late}
    w.row.measurements["seqs not published"] = f"{len(missing)} of {max(w.recorder.seqs) - first_seq}"
    w.check(seen <= count <= FAULTS, f"{FAULTS} faults happened, {seen} were seen, {count} were published")
    w.check(len(missing) <= overtaken, f"{len(missing)} seqs are missing, {overtaken:.0f} states overtaken")
    w.check_rates(before, during, tolerance=RATE_TOLERANCE if seconds >= 60 else SHORT_RATE_TOLERANCE)


async def killed_while_away(w: World, count: int) -> None:
    """Faults happen while the broker is away, and the gateway is killed before it could publish them."""
    books = w.recorder.books
    known, happened, seen = books.faults_of("mill"), 0, 0
    await w.calm()
    for _ in range(count):
        await asyncio.to_thread(w.broker.stop)
        for _ in range(w.dice.choice((1, 2))):
            happened += 1
            seen += await w.fault("mill")
            await sleep_fairly(w.dice.uniform(STORED_WITHIN_S, 2 * STORED_WITHIN_S))
            lives = len(w.gateway.lives)
            await w.killed()
            await w.gateway.until_up(lives=lives + 1)
            await sleep_fairly(w.dice.uniform(0.0, 2.0))
        await _back(w, w.broker.start)
    await until(lambda: books.faults_of("mill") >= known + seen, "all faults are published", within_s=10.0)
    published = books.faults_of("mill") - known
    w.row.measurements |= {"kills": happened, "faults seen": seen, "published": published}
    w.row.measurements["repeated"] = books.repeated
    w.check(
        seen <= published <= happened, f"{happened} faults happened, {seen} were seen, {published} published"
    )


async def killed(w: World, count: int) -> None:
    """Kill the broker: sessions and retained messages are gone."""
    slowest_s = 0.0
    for _ in range(count):
        await asyncio.sleep(w.dice.uniform(0.2, 2.0))
        await asyncio.to_thread(w.broker.kill)
        await asyncio.sleep(w.dice.uniform(0.0, 1.0))
        slowest_s = max(slowest_s, await _back(w, w.broker.start))
    w.row.measurements["right again s"] = round(slowest_s, 2)


async def half_open(w: World, count: int) -> None:
    """A broker that stands still: connections stay, nothing is answered."""
    for _ in range(count):
        begun_s = time.monotonic()
        w.broker.stand_still()
        await asyncio.sleep(1.5 * KEEPALIVE_S + 2.0)
        await _back(w, w.broker.go_on)

        def is_noticed(begun_s: float = begun_s) -> bool:
            return bool(w.recorder.events_of("broker_away", begun_s))

        await until(is_noticed, "a broker that stood still was noticed", within_s=10.0)


async def _back(w: World, begin: Callable[[], None]) -> float:
    """Let the broker come back; wait until the gateway has published everything; return how long."""
    boot, back_s = w.recorder.boot, time.monotonic()
    await asyncio.to_thread(begin)
    await w.right(since_s=back_s, within_s=AGAIN_S)

    def is_connected() -> bool:  # what is retained may be from before
        status = w.recorder.newest("gateway/status")
        return status["boot"] != boot and status["state"] in ("online", "degraded")

    await until(is_connected, "the gateway is connected", within_s=10.0)
    return time.monotonic() - back_s


SCENARIOS = (
    Scenario("broker away", CRASH, away, 600, 10, "s"),
    Scenario("killed without broker", CRASH, killed_while_away, 50, 2, "times"),
    Scenario("broker killed", CRASH, killed, 50, 1, "times"),
    Scenario("broker half-open", CRASH, half_open, 20, 1, "times"),
)
