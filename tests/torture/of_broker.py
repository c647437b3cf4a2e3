"""The broker is away, killed, flapping, or takes the connection and says nothing."""

from __future__ import annotations

import asyncio
import signal
import time
from collections.abc import Callable
from pathlib import Path

from tests.torture.scenario import Place, Scenario
from tests.torture.waiting import until
from tests.torture.world import KEEPALIVE_S, RIGHT_WITHIN_S, World

LONGEST_RETRY_S = 4.0  # gateway.mqtt.settings; only then is a broker that is back found
AGAIN_S = LONGEST_RETRY_S + RIGHT_WITHIN_S
SLOWEST_S = 10.0  # the period of the slowest polls: less than that is not one round
RATE_TOLERANCE = 0.02
SHORT_RATE_TOLERANCE = 0.1  # a few seconds are too few polls for two per cent


async def away(w: World, seconds: int) -> None:
    """Stop the broker in order; things happen at the starters meanwhile, and are told afterwards."""
    await w.calm()
    before = await w.rate(max(seconds, SLOWEST_S))
    w.broker.stop()
    known = len(w.recorder.events)
    during = await w.rate(max(seconds, SLOWEST_S))
    for _ in range(3):
        await w.starters.order("fault", starter="mill", number=5)
        await asyncio.sleep(1.0)
        await w.starters.order("keypad_reset", starter="mill")
        await asyncio.sleep(1.0)
    w.broker.start()
    back_s = time.monotonic()
    await w.right(since_s=back_s, within_s=AGAIN_S)

    def faults() -> int:
        return sum(event["code"] == "fault" for event in w.recorder.events[known:])

    await _told(w, lambda: faults() >= 3, "all faults of the outage are told")
    w.figures |= {"polls/s before": round(before, 2), "during": round(during, 2), "faults told": faults()}
    tolerance = RATE_TOLERANCE if seconds >= 60 else SHORT_RATE_TOLERANCE
    w.check(abs(during / before - 1.0) <= tolerance, f"the line's rate changed: {before} -> {during}")
    w.check(faults() == 3, f"3 faults happened, {faults()} were told")


async def killed(w: World, count: int) -> None:
    """Kill the broker: sessions and retained messages are gone."""
    slowest_s = 0.0
    for _ in range(count):
        await asyncio.sleep(w.dice.uniform(0.2, 2.0))
        w.broker.kill()
        await asyncio.sleep(w.dice.uniform(0.0, 1.0))
        w.broker.start()
        back_s = time.monotonic()
        slowest_s = max(slowest_s, await w.right(since_s=back_s, within_s=AGAIN_S))
    w.figures["right again s"] = round(slowest_s, 2)


async def flapping(w: World, seconds: int) -> None:
    """A broker that is there for a second and away for the next."""
    w.sample()
    begun_s = back_s = time.monotonic()
    while back_s - begun_s < seconds:
        w.broker.kill()
        await asyncio.sleep(1.0)
        w.broker.start()
        back_s = time.monotonic()
        await asyncio.sleep(1.0)
    w.figures["right again s"] = round(await w.right(since_s=back_s, within_s=AGAIN_S), 2)
    w.sample()


async def half_open(w: World, count: int) -> None:
    """A broker that stands still: connections stay, nothing is answered."""
    for _ in range(count):
        known = len(w.recorder.events)
        _signal(w, signal.SIGSTOP)
        await asyncio.sleep(1.5 * KEEPALIVE_S + 2.0)
        _signal(w, signal.SIGCONT)
        back_s = time.monotonic()
        await w.right(since_s=back_s, within_s=AGAIN_S)

        def is_noticed(known: int = known) -> bool:
            return any(event["code"] == "broker_away" for event in w.recorder.events[known:])

        await _told(w, is_noticed, "a broker that stood still was noticed")


async def _told(w: World, is_true: Callable[[], bool], what: str) -> None:
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
    Scenario("broker killed", Place.BROKER, killed, 50, 1, "times"),
    Scenario("broker flapping", Place.BROKER, flapping, 600, 4, "s"),
    Scenario("broker half-open", Place.BROKER, half_open, 20, 1, "times"),
)
