"""Stops under a flood of large messages, and second stops amid starts at the keypad."""

from __future__ import annotations

import asyncio
import json
import math
import os
import random
import sys
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from tests.lab.torture.command_site import BASE, CommandSite
from tests.lab.torture.of_flood import computed_s
from tests.lab.torture.recorder import is_final
from tests.lab.torture.world import STOP_WITHIN_S

PUMP = "pump"  # an SSW-07
FLOOD_PER_S, FLOOD_BYTES = 6000, 4096
FLOODED_S = 2.0  # before the first stop
NEVER_S = 10.0
READINGS = 2  # that confirm a stop
AGAIN_S = 1.0  # without a result an operator sends a stop again
MESSAGES = 5  # of one stop
LOST_SHARE = 0.25  # of the messages, on a machine that floods itself
SETTLED_S = 10.0  # until a flooded gateway has said what became of the last stop
# Writes evenly paced lines for `mosquitto_pub -l`, in a process of its own.
WRITER = """
import sys, time
per_s, seconds, line = int(sys.argv[1]), float(sys.argv[2]), sys.argv[3].encode() + b"\\n"
began_s, sent = time.monotonic(), 0
while (gone_s := time.monotonic() - began_s) < seconds:
    due = int(gone_s * per_s)
    lines = (line.replace(b"flood", b"flood-%d" % number) for number in range(sent, due))
    sys.stdout.buffer.write(b"".join(lines))
    sys.stdout.buffer.flush()
    sent = due
    time.sleep(0.005)
"""


async def stops_in_a_large_flood(site: CommandSite, seconds: int, seed: int) -> None:
    """Flood with messages of 4 KB; each stop's frame is at the starter within the bound.

    What the gateway says of a message decides whether it got it: then a frame follows within the bound. What
    never arrives is the broker's loss (when a client's queue is full Mosquitto drops packets of QoS 1 too,
    and logs them as sent): the operator, who sees no result, sends the stop again after AGAIN_S. So each stop
    is carried out, with MESSAGES at most; the messages that are lost are counted, and may be a LOST_SHARE.
    """
    dice = random.Random(seed)
    flooded = []
    async with _large_flood(site, FLOODED_S + 2.0 * seconds):
        await asyncio.sleep(FLOODED_S)
        for number in range(seconds):
            flooded.append(await _flooded_stop(site, f"stop-{number}"))
            await asyncio.sleep(dice.uniform(0.5, 1.0))
    await asyncio.sleep(SETTLED_S)
    judge_flooded(site, flooded)
    refused = sum(each.get("count", 1) for each in site.listener.results if each["code"] == "too_many")
    site.measurements["refused"] = refused
    site.check(refused > 0, "nothing was refused as too many")
    site.check(len(site.gateway.lives) == 1, "the gateway died")


@dataclass
class FloodedStop:
    """A stop in a flood, sent again until there is a frame."""

    ids: list[str]  # of its messages
    waited_s: float = NEVER_S  # from the first message to the frame
    framed_utc_s: float = math.inf  # when the frame came


async def _flooded_stop(site: CommandSite, id_: str) -> FloodedStop:
    stop, begun_s = FloodedStop([]), time.monotonic()
    while stop.waited_s == NEVER_S and len(stop.ids) < MESSAGES:
        stop.ids.append(f"{id_}-{len(stop.ids)}")
        took_s = await _frame_of_a_stop(site, json.dumps({"id": stop.ids[-1]}), within_s=AGAIN_S)
        if took_s < NEVER_S:
            stop.waited_s, stop.framed_utc_s = time.monotonic() - begun_s, time.time()
    return stop


def judge_flooded(site: CommandSite, flooded: list[FloodedStop]) -> None:
    """Check each stop by its frame, and its messages by what the gateway itself says of them."""
    bound_s = STOP_WITHIN_S + computed_s(site)
    messages = [id_ for stop in flooded for id_ in stop.ids]
    lost = [id_ for id_ in messages if not site.listener.of(id_)]
    inside_s = [
        stop.framed_utc_s - min(_taken_utc_s(site, id_) for id_ in stop.ids if id_ not in lost)
        for stop in flooded
        if not set(stop.ids) <= set(lost)
    ]
    waited_s = sorted(stop.waited_s for stop in flooded)
    without = [stop.ids for stop in flooded if stop.waited_s == NEVER_S]
    site.check(not without, f"no frame: {without}")
    late_s = max(inside_s, default=math.inf)
    site.check(late_s <= bound_s, f"a frame came {late_s:.3f} s after its stop was taken, {bound_s:.3f} s")
    most = LOST_SHARE * len(messages)
    site.check(len(lost) <= most, f"{len(lost)} of {len(messages)} messages never arrived")
    site.measurements |= {
        "stops": len(flooded),
        "messages": len(messages),
        "lost by the broker": len(lost),
        "frame s, median": round(waited_s[len(waited_s) // 2], 3),
        "worst": round(waited_s[-1], 3),
        "worst since taken": round(late_s, 3),
        "bound s": round(bound_s, 3),
    }


def _taken_utc_s(site: CommandSite, id_: str) -> float:
    """Return when the gateway took a stop, by its own word; the one machine has one clock."""
    return datetime.fromisoformat(site.listener.of(id_)[0]["time"]).timestamp()


async def second_stops(site: CommandSite, count: int, seed: int) -> None:
    """Stop, start at the keypad, stop again: the second has its frame, and is confirmed by what follows."""
    dice = random.Random(seed)
    unit: Any = site.ears[PUMP].unit
    bound_s = STOP_WITHIN_S + computed_s(site)
    waited_s, together = [], 0
    for number in range(count):
        site.listener.publish(f"command/{PUMP}/alice/stop", json.dumps({"id": f"first-{number}"}))
        await asyncio.sleep(dice.uniform(0.02, 0.35))
        unit._set_remote(is_remote=False)
        unit.keypad_start()
        unit._set_remote(is_remote=True)
        await asyncio.sleep(dice.uniform(0.0, 0.05))
        together += not any(is_final(each) for each in site.listener.of(f"first-{number}"))
        id_ = f"second-{number}"
        waited_s.append(await _frame_of_a_stop(site, json.dumps({"id": id_})))
        frame_s = next(at_s for at_s, _ in reversed(site.ears[PUMP].writes()))
        final = await site.result(
            lambda each, id_=id_: each["id"] == id_ and is_final(each), f"the end of {id_}"
        )  # type: ignore[misc]  # mypy knows no lambda with a default
        read = [at_s for at_s, pdu in site.ears[PUMP].received if at_s > frame_s and pdu[0] in (1, 3, 4)]
        site.check(final["phase"] == "confirmed", f"a stop ended as {final}")
        site.check(len(read) >= READINGS, f"{id_} was confirmed by readings from before its frame")
        site.check(not unit.motor.is_turned_on, f"{id_} was confirmed, and the motor is on")
    site.check(max(waited_s) <= bound_s, f"a stop's frame took {max(waited_s):.3f} s, bound {bound_s:.3f} s")
    site.measurements |= {
        "joined": together,
        "frame s, worst": round(max(waited_s), 3),
        "bound s": round(bound_s, 3),
    }


async def _frame_of_a_stop(site: CommandSite, payload: str = "", *, within_s: float = NEVER_S) -> float:
    """Send a stop; return after what time a frame of it was at the starter, NEVER_S when it was not."""
    ear, begun_s = site.ears[PUMP], time.monotonic()
    since = len(ear.received)
    site.listener.publish(f"command/{PUMP}/alice/stop", payload)
    while time.monotonic() - begun_s < within_s:
        await asyncio.sleep(0.002)
        if times_s := [at_s for at_s, _ in ear.writes(since=since) if at_s >= begun_s]:
            return times_s[0] - begun_s
    return NEVER_S


@asynccontextmanager
async def _large_flood(site: CommandSite, seconds: float) -> AsyncIterator[None]:
    """Publish from processes of their own, so that what is measured here does not suffer."""
    args = {"parameter": "P314", "pad": "y" * (FLOOD_BYTES - 200)}
    line = json.dumps({"id": "flood", "boot": site.listener.boot, "args": args})
    writer = await asyncio.create_subprocess_exec(
        *(sys.executable, "-c", WRITER, str(FLOOD_PER_S), str(seconds), line), stdout=(pipe := _pipe())[1]
    )
    topic = f"{BASE}/command/fan/bob/read"
    where = ("-h", site.broker.host, "-p", str(site.broker.port), "-q", "0", "-t", topic, "-l")
    publisher = await asyncio.create_subprocess_exec("mosquitto_pub", *where, stdin=pipe[0])
    for end in pipe:
        end.close()
    try:
        yield
    finally:
        for process in (writer, publisher):
            if process.returncode is None:
                process.terminate()
            await process.wait()


def _pipe() -> tuple[Any, Any]:
    reading, writing = os.pipe()
    return os.fdopen(reading, "rb"), os.fdopen(writing, "wb")
