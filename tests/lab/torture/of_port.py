"""The port goes and comes back, goes deaf, or is flooded."""

from __future__ import annotations

import asyncio
import time

from gateway.line import EXPIRES_S
from tests.lab.torture.machine import until
from tests.lab.torture.scenario import PORT, Scenario
from tests.lab.torture.world import World

AWAY_WITHIN_S = PORT.deaf_after_s + 2.0  # four polls of 1 s without an answer, or the port taken for deaf
CPU_SHARE = 0.5


async def replugged(w: World, count: int) -> None:
    """Unplug; everything is shown as stale; plug in again under another number."""
    w.sample()
    slowest_s = 0.0
    for _ in range(count):
        await w.starters.order("unplug")
        await until(lambda: _is_all_away(w), "all starters are shown as away", within_s=2.0)
        await until(lambda: not _good_values(w), "no value is shown as good", within_s=1.0)
        await asyncio.sleep(w.dice.uniform(0.0, 3.0))
        plugged_s = time.monotonic()
        await w.starters.order("plug")
        await w.right(since_s=plugged_s)
        slowest_s = max(slowest_s, time.monotonic() - plugged_s)
    w.sample()
    w.row.measurements |= {"right again s": round(slowest_s, 2), "files": w.samples[-1][1]}


async def deaf(w: World, count: int) -> None:
    """The port receives nothing until it is closed and opened again."""
    w.sample()
    slowest_s = 0.0
    for _ in range(count):
        begun_s = time.monotonic()
        await w.starters.order("deafen")

        def reports(begun_s: float = begun_s) -> list[float]:
            return w.recorder.events_of("port_deaf", begun_s)

        await until(reports, "event port_deaf", within_s=4 * PORT.deaf_after_s)
        await w.right(since_s=reports()[0])
        slowest_s = max(slowest_s, time.monotonic() - begun_s)
        w.check(len(reports()) == 1, f"a deaf port was reported {len(reports())} times")
    w.sample()
    w.row.measurements["received again s"] = round(slowest_s, 2)


async def garbage(w: World, seconds: int, **byte: int) -> None:
    """Random bytes, as fast as the line carries them.

    They come for longer than a starter may be shown as good without an answer; what is right then is news.
    """
    first, begun_s = w.sample(), time.monotonic()
    await w.starters.order("flood", seconds=seconds, **byte)
    await until(lambda: _is_all_away(w), "all starters are shown as away", within_s=AWAY_WITHIN_S)
    w.row.measurements["away s"] = round(time.monotonic() - begun_s, 2)
    await asyncio.sleep(begun_s + seconds - time.monotonic())
    w.check(_is_all_away(w), "a starter is shown as there while the line is flooded")
    share = (w.sample().cpu_s - first.cpu_s) / (time.monotonic() - begun_s)
    right_s = await w.right(since_s=begun_s + seconds)
    w.row.measurements |= {"CPU": f"{share:.0%}", "right again s": round(right_s, 2)}
    w.check(share < CPU_SHARE, f"a flood takes {share:.0%} of a core")


async def endless_break(w: World, seconds: int) -> None:
    """Zeros without end, as a broken wire or a shorted line looks to a UART.

    It begins when no reply of the flood before is owed any more: each would make the return take longer.
    """
    await asyncio.sleep(EXPIRES_S)
    await garbage(w, seconds, byte=0)


def _is_all_away(w: World) -> bool:
    latest = w.recorder.latest
    topics = [topic for topic in latest if topic.startswith("starter/") and topic.endswith("/availability")]
    return bool(topics) and all(latest[topic]["state"] == "offline" for topic in topics)


def _good_values(w: World) -> list[str]:
    """Return the values that are shown as good at present."""
    values = [(topic, body) for topic, body in list(w.recorder.latest.items()) if "/value/" in topic]
    return [topic for topic, body in values if body.get("quality") == "good"]


SCENARIOS = (
    Scenario("port replugged", PORT, replugged, 100, 2, "times", may_trip=True),
    Scenario("port deaf", PORT, deaf, 20, 1, "times", may_trip=True),
    Scenario("garbage at line rate", PORT, garbage, 300, 8, "s", may_trip=True),
    Scenario("endless break", PORT, endless_break, 300, 8, "s", may_trip=True),
)
