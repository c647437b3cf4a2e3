"""The broker is away, killed, or takes the connection and says nothing."""

from __future__ import annotations

import asyncio
import signal
import time
from collections.abc import Callable
from pathlib import Path

from tests.lab.torture.plant_site import KEEPALIVE_S, STARTERS
from tests.lab.torture.scenario import Place, Scenario
from tests.lab.torture.waiting import sleep_fairly, until
from tests.lab.torture.world import RIGHT_WITHIN_S, World

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
    known, known_late = books.count("fault", starter="mill"), books.published_late
    await asyncio.to_thread(w.broker.stop)
    begun_s, first_seq = time.monotonic(), max(w.recorder.seqs)
    during = await w.rate(max(seconds, SLOWEST_S))
    seen = sum([await w.fault("mill") for _ in range(FAULTS)])
    await back(w, w.broker.start)
    await wait_for(
        w, lambda: books.count("fault", starter="mill") >= known + seen, "all faults are published"
    )
    await _until_drained(w)
    count = books.count("fault", starter="mill") - known
    missing = set(range(first_seq, max(w.recorder.seqs))) - w.recorder.seqs
    overtaken = FAULTS * RECORDS_OF_A_FAULT + len(STARTERS) * (
        1 + (time.monotonic() - begun_s) / LATEST_EVERY_S
    )
    w.measurements |= {"faults published": count, "values published late": books.published_late - known_late}
    w.measurements["seqs not published"] = f"{len(missing)} of {max(w.recorder.seqs) - first_seq}"
    w.check(seen <= count <= FAULTS, f"{FAULTS} faults happened, {seen} were seen, {count} were published")
    w.check(len(missing) <= overtaken, f"{len(missing)} seqs are missing, {overtaken:.0f} states overtaken")
    w.check_rates(before, during, tolerance=tolerance_of(seconds))


async def killed_while_away(w: World, count: int) -> None:
    """Faults happen while the broker is away, and the gateway is killed before it could publish them."""
    books = w.recorder.books
    known, happened, seen = books.count("fault", starter="mill"), 0, 0
    await w.calm()
    for _ in range(count):
        await asyncio.to_thread(w.broker.stop)
        for _ in range(w.dice.choice((1, 2))):
            happened += 1
            seen += await w.fault("mill")
            await sleep_fairly(w.dice.uniform(STORED_WITHIN_S, 2 * STORED_WITHIN_S))
            lives = len(w.gateway.lives)
            w.gateway.signal(signal.SIGKILL)
            await w.gateway.until_up(lives=lives + 1)
            await sleep_fairly(w.dice.uniform(0.0, 2.0))
        await back(w, w.broker.start)
    await wait_for(
        w, lambda: books.count("fault", starter="mill") >= known + seen, "all faults are published"
    )
    await _until_drained(w)
    count = books.count("fault", starter="mill") - known
    w.measurements |= {
        "kills": happened,
        "faults seen": seen,
        "published": count,
        "values published late": books.published_late,
    }
    w.measurements |= {"repeated": books.repeated, "losses declared": len(books.declared)}
    w.check(
        seen <= count <= happened, f"{happened} faults happened, {seen} were seen, {count} were published"
    )


async def _until_drained(w: World) -> None:
    """Wait until no history has come for a while."""
    late = -1
    while late != w.recorder.books.published_late:
        late = w.recorder.books.published_late
        await sleep_fairly(QUIET_S)


def tolerance_of(seconds: float) -> float:
    """Return by how much a line's rate may differ when it is counted for so long."""
    return RATE_TOLERANCE if seconds >= 60 else SHORT_RATE_TOLERANCE


async def killed(w: World, count: int) -> None:
    """Kill the broker: sessions and retained messages are gone."""
    slowest_s = 0.0
    for _ in range(count):
        await asyncio.sleep(w.dice.uniform(0.2, 2.0))
        await asyncio.to_thread(w.broker.kill)
        await asyncio.sleep(w.dice.uniform(0.0, 1.0))
        slowest_s = max(slowest_s, await back(w, w.broker.start))
    w.measurements["right again s"] = round(slowest_s, 2)


async def half_open(w: World, count: int) -> None:
    """A broker that stands still: connections stay, nothing is answered."""
    for _ in range(count):
        known = len(w.recorder.events)
        _signal(w, signal.SIGSTOP)
        await asyncio.sleep(1.5 * KEEPALIVE_S + 2.0)
        await back(w, lambda: _signal(w, signal.SIGCONT))

        def is_noticed(known: int = known) -> bool:
            return any(event["code"] == "broker_away" for event in w.recorder.events[known:])

        await wait_for(w, is_noticed, "a broker that stood still was noticed")


async def back(w: World, begin: Callable[[], None]) -> float:
    """Let the broker come back; wait until the gateway has published everything; return how long."""
    token = w.recorder.latest["gateway/status"]["boot"]
    back_s = time.monotonic()
    await asyncio.to_thread(begin)
    await w.right(since_s=back_s, within_s=AGAIN_S)

    def is_connected() -> bool:
        status = w.recorder.latest["gateway/status"]
        return status["boot"] != token and status["state"] in ("online", "degraded")

    await wait_for(w, is_connected, "the gateway is connected")  # what is retained may be from before
    return time.monotonic() - back_s


async def wait_for(w: World, is_true: Callable[[], bool], what: str) -> None:
    try:
        await until(is_true, what, within_s=10.0)
    except TimeoutError as error:
        w.check(False, str(error))


def _signal(w: World, number: signal.Signals) -> None:
    process = w.broker._process
    assert process is not None
    assert Path(f"/proc/{process.pid}").exists()
    process.send_signal(number)


SCENARIOS = (
    Scenario("broker away", Place.BROKER, away, 600, 10, "s"),
    Scenario("killed without broker", Place.BROKER, killed_while_away, 50, 2, "times", quick=1),
    Scenario("broker killed", Place.BROKER, killed, 50, 1, "times", quick=1),
    Scenario("broker half-open", Place.BROKER, half_open, 20, 1, "times", quick=1),
)
