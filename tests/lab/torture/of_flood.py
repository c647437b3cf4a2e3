"""A thousand commands a second from three users, and a stop in the middle of them."""

from __future__ import annotations

import asyncio
import json
import struct
import time
from collections import Counter
from collections.abc import Collection, Mapping
from contextlib import AsyncExitStack
from itertools import pairwise

from tests.lab.torture.command_site import STARTERS, USERS, WRITES, CommandSite, Pipe
from tests.lab.torture.world import STOP_WITHIN_S
from tests.lab.usage import usage

WHOLE_S = 60  # from here on a thousand a second
CALM_S = 6.0
BATCH_S = 0.01
GROWTH_KB = 20_000
RATE_HELD = 0.8  # of every poll's rate in calm; commands that are within the limits need the line as well
READ_SIZE = 5  # of the PDU that asks for registers or coils
READ_WORDS = 3
STATUS_WORD = bytes.fromhex("0313890001")  # VB01
STATUS_COILS = bytes.fromhex("0100000010")
PARAMETER = "P314"  # not polled; the families that lack it refuse


Read = tuple[str, bytes]  # starter and PDU
Polls = dict[Read, tuple[float, float]]  # so many a second, longest pause in seconds


async def flood(site: CommandSite, seconds: int, seed: int) -> None:
    """Flood for that long; memory, polls and the stop keep their bounds."""
    per_s = 1000 if seconds >= WHOLE_S else 200
    standing = await _polls(site, CALM_S)
    site.listener.command("pump", "start", "before-flood")
    site.check(
        (await site.listener.final("before-flood"))["phase"] == "confirmed", "no start before the flood"
    )
    await site.listener.until("starter/pump/state", within_s=60.0, state="running")
    await asyncio.sleep(1.0)
    running = await _polls(site, CALM_S)
    calm = {key: min(standing[key], running[key]) for key in standing.keys() & running.keys()}
    memory_kb = [usage(site.gateway.pid).rss_kib]
    since = len(site.listener.results)
    measuring = asyncio.create_task(_polls(site, seconds - 0.5, calm))
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
    held = _held_rates(site, calm, flooded)
    half = memory_kb[len(memory_kb) // 2]
    site.measurements |= {
        "sent": sent,
        "results": len(results),
        "stop s": round(stop_s, 3),
        "polls held": held,
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


async def _polls(site: CommandSite, seconds: float, also: Collection[Read] = ()) -> Polls:
    """Return rate and longest gap of every request that is not a write, and of these others."""
    marks = {name: site.mark(name) for name in STARTERS}
    await asyncio.sleep(seconds)
    times: dict[Read, list[float]] = {}
    for name, mark in marks.items():
        for at_s, pdu in site.ears[name].received[mark:]:
            if pdu[0] not in WRITES:
                times.setdefault((name, pdu), []).append(at_s)
    return {poll: _rate_and_gap(times, poll, seconds) for poll in times.keys() | set(also)}


def _rate_and_gap(times: Mapping[Read, list[float]], poll: Read, seconds: float) -> tuple[float, float]:
    """Return how often, and with which longest pause, what a poll asks for was read."""
    at_s = sorted(each_s for read, all_s in times.items() if _covers(read, poll) for each_s in all_s)
    return len(at_s) / seconds, max((b - a for a, b in pairwise(at_s)), default=seconds)


def _covers(read: Read, poll: Read) -> bool:
    """Return whether a read gives all that a poll asks for: the same rows may be read in a longer form."""
    (one, long), (other, short) = read, poll
    if one != other or not len(long) == len(short) == READ_SIZE:
        return read == poll
    if (long, short[0]) == (STATUS_COILS, READ_WORDS):
        return short == STATUS_WORD  # its bits as coils (ssw06-es 4.2.1, ssw07 4.2.1)
    if long[0] != short[0]:
        return False
    (start, count), (first, wanted) = (struct.unpack(">HH", pdu[1:]) for pdu in (long, short))
    return bool(start <= first and first + wanted <= start + count)


def _held_rates(site: CommandSite, calm: Polls, flooded: Polls) -> str:
    """Compare the polls that come about once a second in calm; return the worst share and gap.

    A motor that stands is asked for its current less often: the stop in the flood must not count as a loss.
    """
    worst, gap_s, calm_gap_s = 9.0, 0.0, 0.0
    for key, (rate, longest_s) in calm.items():
        if rate < 0.7:
            continue
        now_rate, now_gap_s = flooded[key]
        worst = min(worst, now_rate / rate)
        gap_s, calm_gap_s = max(gap_s, now_gap_s), max(calm_gap_s, longest_s)
        name, pdu = key
        site.check(
            now_rate >= RATE_HELD * rate, f"{name} {pdu.hex()}: {rate:.2f} polls a second -> {now_rate:.2f}"
        )
    return f"{worst:.2f} (longest gap {calm_gap_s:.2f} -> {gap_s:.2f} s)"


def computed_s(site: CommandSite) -> float:
    statistics = site.listener.latest.get("gateway/line/hall", {})
    return float(statistics.get("stop_latency_s", {}).get("computed", 1.0))
