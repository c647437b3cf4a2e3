"""A thousand commands a second from three users, and a stop in the middle of them."""

from __future__ import annotations

import asyncio
import json
import time
from collections import Counter
from contextlib import AsyncExitStack

from tests.lab.torture.command_site import STARTERS, USERS, WRITES, CommandSite, Pipe
from tests.lab.torture.world import STOP_WITHIN_S
from tests.lab.usage import usage

WHOLE_S = 60  # from here on a thousand a second
CALM_S = 6.0
BATCH_S = 0.01
GROWTH_KB = 20_000
RATE_HELD = 0.8  # of a starter's polls in calm; commands that are within the limits need the line as well
PARAMETER, ASKED = "P314", (314).to_bytes(2, "big")  # not polled; the families that lack it refuse


async def flood(site: CommandSite, seconds: int, seed: int) -> None:
    """Flood for that long; memory, polls and the stop keep their bounds."""
    per_s = 1000 if seconds >= WHOLE_S else 200
    site.listener.command("pump", "start", "before-flood")
    site.check(
        (await site.listener.final("before-flood"))["phase"] == "confirmed", "no start before the flood"
    )
    await site.listener.until("starter/pump/state", within_s=60.0, state="running")
    await asyncio.sleep(1.0)
    calm = await _polls(site, CALM_S)
    memory_kb = [usage(site.gateway.pid).rss_kib]
    since = len(site.listener.results)
    measuring = asyncio.create_task(_polls(site, seconds - 0.5))
    sampling = asyncio.create_task(_sample(site, memory_kb))
    stopping = asyncio.create_task(_stop(site, seconds / 2))
    sent = await _pour(site, per_s, seconds)
    stop_s, flooded = await stopping, await measuring
    await asyncio.sleep(1.0)
    sampling.cancel()
    bound_s = STOP_WITHIN_S + computed_s(site)
    results = site.listener.results[since:]
    site.check(stop_s <= bound_s, f"the stop took {stop_s:.3f} s, bound {bound_s:.3f} s")
    site.check(
        max(memory_kb) - memory_kb[0] < GROWTH_KB, f"memory grew: {memory_kb[0]} -> {max(memory_kb)} KB"
    )
    held = {name: flooded[name] / calm[name] for name in STARTERS if name != "pump"}  # that is stopped
    for name, share in held.items():
        site.check(share >= RATE_HELD, f"{name}: {calm[name]:.1f} polls a second -> {flooded[name]:.1f}")
    half = memory_kb[len(memory_kb) // 2]
    site.measurements |= {
        "sent": sent,
        "results": len(results),
        "stop s": round(stop_s, 3),
        "polls held": round(min(held.values()), 2),
    }
    site.measurements |= {"bound s": round(bound_s, 3), "KB": f"{memory_kb[0]}, {half}, {max(memory_kb)}"}
    codes = Counter(each["code"] for each in results)
    site.measurements["refused"] = codes["too_many"]
    site.check(codes["too_many"] > 0, f"nothing was refused as too many: {codes}")
    answered = len({each["id"] for each in results if each["id"]})
    counted = sum(each.get("count", 0) for each in results)
    site.measurements["accounted for"] = answered + counted
    site.check(len(site.gateway.lives) == 1, "the gateway died")


async def _pour(site: CommandSite, per_s: int, seconds: int) -> int:
    """Publish evenly from three users; return how many messages."""
    async with AsyncExitStack() as stack:
        pipes = [
            await stack.enter_async_context(Pipe(site.broker, f"command/{starter}/{user}/read", "mqttv5"))
            for user in USERS
            for starter in STARTERS
        ]
        begun_s = time.monotonic()
        number = 0
        while (gone_s := time.monotonic() - begun_s) < seconds:
            while number < gone_s * per_s:
                command = {
                    "id": f"flood-{number}",
                    "token": site.listener.token,
                    "args": {"parameter": PARAMETER},
                }
                pipes[number % len(pipes)].say(json.dumps(command))
                number += 1
            await asyncio.sleep(BATCH_S)
    return number


async def _stop(site: CommandSite, after_s: float) -> float:
    """Stop the pump in the flood; return how long its frame took."""
    await asyncio.sleep(after_s)
    ear, begun_s = site.ears["pump"], time.monotonic()
    site.listener.publish("command/pump/alice/stop", "")
    while time.monotonic() - begun_s < 10.0:
        await asyncio.sleep(0.005)
        if times_s := [at_s for at_s, _ in ear.writes() if at_s >= begun_s]:
            return times_s[0] - begun_s
    return 10.0


async def _sample(site: CommandSite, memory_kb: list[int]) -> None:
    while True:
        await asyncio.sleep(0.5)
        memory_kb.append(usage(site.gateway.pid).rss_kib)


async def _polls(site: CommandSite, seconds: float) -> dict[str, float]:
    """Return how many requests a second each starter gets that write nothing, and are none of the flood's."""
    marks = {name: site.mark(name) for name in STARTERS}
    await asyncio.sleep(seconds)
    return {
        name: sum(pdu[0] not in WRITES and pdu[1:3] != ASKED for _, pdu in site.ears[name].received[mark:])
        / seconds
        for name, mark in marks.items()
    }


def computed_s(site: CommandSite) -> float:
    statistics = site.listener.latest.get("gateway/line/hall", {})
    return float(statistics.get("stop_latency_s", {}).get("computed", 1.0))
