"""Stops under a flood of large messages, and second stops amid starts at the keypad."""

from __future__ import annotations

import asyncio
import json
import os
import random
import sys
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

from tests.torture.command_site import BASE, CommandSite
from tests.torture.of_flood import computed_s
from tests.torture.recorder import is_final
from tests.torture.world import STOP_WITHIN_S

PUMP = "pump"  # an SSW-07
FLOOD_PER_S, FLOOD_BYTES = 6000, 4096
FLOODED_S = 2.0  # before the first stop
NEVER_S = 10.0
READINGS = 2  # that confirm a stop
LOST_SHARE = 0.0  # of the stops that the broker acknowledged
DROPPING = "Outgoing messages are being dropped"  # Mosquitto's own words
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

    A stop that the gateway never got is not excused: the broker may lose `LOST_SHARE` of them, and none that
    the gateway has accepted may lack its frame.
    """
    dice = random.Random(seed)
    bound_s = STOP_WITHIN_S + computed_s(site)
    waited_s = {}
    async with _large_flood(site, FLOODED_S + 2.0 * seconds):
        await asyncio.sleep(FLOODED_S)
        for number in range(seconds):
            id_ = f"stop-{number}"
            waited_s[id_] = await _frame_of_a_stop(site, json.dumps({"id": id_}))
            await asyncio.sleep(dice.uniform(0.5, 1.0))
    await asyncio.sleep(NEVER_S if NEVER_S in waited_s.values() else 1.0)
    _judge_flooded(site, waited_s, bound_s)
    refused = sum(each.get("count", 1) for each in site.listener.results if each["code"] == "too_many")
    site.figures["refused"] = refused
    site.check(refused > 0, "nothing was refused as too many")
    site.check(len(site.gateway.lives) == 1, "the gateway died")


def _judge_flooded(site: CommandSite, waited_s: dict[str, float], bound_s: float) -> None:
    """Check each stop by what the gateway itself says of it."""
    lost = [id_ for id_ in waited_s if not site.listener.of(id_)]
    taken_s = sorted(each for id_, each in waited_s.items() if id_ not in lost) or [NEVER_S]
    without = [id_ for id_, each in waited_s.items() if each == NEVER_S and id_ not in lost]
    site.check(not without, f"accepted, but without a frame: {without[:3]}")
    site.check(taken_s[-1] <= bound_s, f"a stop's frame took {taken_s[-1]:.3f} s, bound {bound_s:.3f} s")
    site.check(len(lost) <= LOST_SHARE * len(waited_s), f"{len(lost)} of {len(waited_s)} stops never arrived")
    site.figures |= {
        "stops": len(waited_s),
        "lost before the gateway": len(lost),
        "frame s, median": round(taken_s[len(taken_s) // 2], 3),
        "worst": round(taken_s[-1], 3),
        "bound s": round(bound_s, 3),
        "flood dropped by the broker": "dropped" if DROPPING in site.broker.log() else "no",
    }


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
        read = [at_s for at_s, pdu in site.ears[PUMP].heard if at_s > frame_s and pdu[0] in (1, 3, 4)]
        site.check(final["phase"] == "confirmed", f"a stop ended as {final}")
        site.check(len(read) >= READINGS, f"{id_} was confirmed by readings from before its frame")
        site.check(not unit.motor.is_turned_on, f"{id_} was confirmed, and the motor is on")
    site.check(max(waited_s) <= bound_s, f"a stop's frame took {max(waited_s):.3f} s, bound {bound_s:.3f} s")
    site.figures |= {
        "joined": together,
        "frame s, worst": round(max(waited_s), 3),
        "bound s": round(bound_s, 3),
    }


async def _frame_of_a_stop(site: CommandSite, payload: str = "") -> float:
    """Send a stop; return after what time a frame of it was at the starter, at most 10 s."""
    ear, begun_s = site.ears[PUMP], time.monotonic()
    since = len(ear.heard)
    site.listener.publish(f"command/{PUMP}/alice/stop", payload)
    while time.monotonic() - begun_s < NEVER_S:
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
