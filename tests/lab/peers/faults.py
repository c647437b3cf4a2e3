"""What is done to each contender; always the same, for the same time."""

from __future__ import annotations

import asyncio
import signal
import time
from collections.abc import Awaitable, Callable
from dataclasses import dataclass

from tests.lab.peers.bout import EVERY_S, STOP_FRAME, Bout
from tests.lab.peers.contenders import STARTERS

PEACE_S = 20.0
AFTER_S = 12.0  # for those that recover
DEAD_S, BROKER_AWAY_S, CUT_S, BAD_LINE_S, RETURNS_S = 30.0, 60.0, 5.0, 40.0, 20.0
LATE_SHARE, BYTE_ERRORS = 0.05, 0.03
KILLS, KILL_PACE_S = 3, 5.3  # not in step with anybody
STOPS, STOP_WITHIN_S, STOP_PACE_S = 12, 10.0, 0.77
STALE_S = 5.0  # what an operator wanted so long ago


async def nothing(b: Bout) -> None:
    await asyncio.sleep(PEACE_S)


async def dead_starter(b: Bout) -> None:
    await b.starters.order("switch", starter="mill", is_on=False)
    await asyncio.sleep(DEAD_S)


async def broker_away(b: Bout) -> None:
    b.stop_broker()
    await asyncio.sleep(BROKER_AWAY_S)
    b.broker.start()
    await asyncio.sleep(AFTER_S)


async def broker_wiped(b: Bout) -> None:
    b.wipe_broker()
    await asyncio.sleep(1.0)
    b.broker.start()
    await asyncio.sleep(AFTER_S)


async def killed(b: Bout) -> None:
    for _ in range(KILLS):
        b.kills += 1
        b.service.signal(signal.SIGKILL)
        await asyncio.sleep(KILL_PACE_S)
    await asyncio.sleep(AFTER_S - KILL_PACE_S)


async def port_replugged(b: Bout) -> None:
    await b.starters.order("unplug")
    cut_s = time.monotonic()
    await asyncio.sleep(CUT_S)
    await b.starters.order("plug")
    b.away = {name: [(cut_s, time.monotonic())] for name in STARTERS}
    await asyncio.sleep(AFTER_S)


async def late_replies(b: Bout) -> None:
    await b.starters.order("corrupt", late_share=LATE_SHARE)
    await asyncio.sleep(BAD_LINE_S)


async def byte_errors(b: Bout) -> None:
    await b.starters.order("corrupt", byte_error_rate=BYTE_ERRORS)
    await asyncio.sleep(BAD_LINE_S)


async def retained_start(b: Bout) -> None:
    await b.starters.order("halt", starter="pump")
    b.kills += 1
    await b.service.stop()
    b.stale_after_s = b.recorder.order("pump", "start", retain=True)
    b.service.start()
    await asyncio.sleep(AFTER_S)


async def write_to_dead_starter(b: Bout) -> None:
    await b.starters.order("switch", starter="pump", is_on=False)
    await asyncio.sleep(3.0)
    b.stale_after_s = b.recorder.order("pump", "start") + STALE_S
    await asyncio.sleep(RETURNS_S)
    await b.starters.order("switch", starter="pump", is_on=True)
    await asyncio.sleep(AFTER_S)


async def stops(b: Bout) -> None:
    for number in range(STOPS):
        await b.starters.order("run")
        await asyncio.sleep(STOP_PACE_S)
        b.stops_s.append(await _stop(b, STARTERS[number % len(STARTERS)]))


async def _stop(b: Bout, starter: str) -> float | None:
    """Order a stop; return how long it took to the wire."""
    sent_s = b.recorder.order(starter, "stop")
    while time.monotonic() - sent_s < STOP_WITHIN_S:
        await asyncio.sleep(0.02)
        if times_s := await b.writes(starter, STOP_FRAME, sent_s):
            return times_s[0] - sent_s
    return None


@dataclass(frozen=True)
class Fault:
    """Something that happens, and how the contender is set when it does."""

    name: str
    happen: Callable[[Bout], Awaitable[None]]
    every_s: float = EVERY_S
    is_about_writes: bool = False


FAULTS = (
    Fault("none, 20 s", nothing),
    Fault("one of four starters without power, 30 s", dead_starter),
    Fault("broker away, 60 s", broker_away),
    Fault("broker killed, its state lost", broker_wiped),
    Fault("SIGKILL, 3 times", killed),
    Fault("port replugged after 5 s", port_replugged),
    Fault("5 % of replies 0.05 to 1 s late, 40 s", late_replies),
    Fault("3 % of bytes wrong, both ways, 40 s", byte_errors),
    Fault("retained `start` waiting at connect", retained_start, is_about_writes=True),
    Fault("`start` to a starter without power, back after 20 s", write_to_dead_starter, is_about_writes=True),
    Fault("12 stops, polling as fast as it can", stops, every_s=0.0, is_about_writes=True),
)
