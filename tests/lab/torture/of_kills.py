"""SIGKILL around a start: never a second start frame, never a dishonest result."""

from __future__ import annotations

import asyncio
import random
import signal
import time
from collections import Counter
from typing import Any

from tests.lab.torture.command_site import PACE_S, STARTERS, UNSTORED, CommandSite
from tests.lab.torture.recorder import is_final
from tests.lab.torture.world import STOP_WITHIN_S

# After publishing: before the ledger, around it, around the write, in the read-back, and after all.
WINDOWS_S = ((0.0, 0.004), (0.004, 0.02), (0.02, 0.1), (0.1, 0.4), (0.4, 1.2))
RECOVERY_S = (0.0, 1.5)  # after it is up again: before the end of what was cut short is published, and after
KILLED_AGAIN = 0.25  # of the times
NOT_YET = ("crashed", *UNSTORED)  # no answers to what is sent again
CLEAN = "clean"
CONFIRMED_WITHIN_S = 1.5  # after a stop's frame: both readings, of motors that stop in a third of it


async def kills(site: CommandSite, count: int, seed: int) -> None:
    """Kill the gateway that many times, each time around the start of one of the starters."""
    dice = random.Random(seed)
    once = {starter: await _clean_start(site, starter) for starter in STARTERS}
    ids: list[tuple[str, str]] = []
    commanded = Counter(STARTERS)
    ends: Counter[str] = Counter()
    for number in range(count):
        starter, id_ = dice.choice(STARTERS), f"kill-{number}"
        commanded[starter] += 1
        received = site.mark(starter)
        end = await _kill(site, starter, id_, dice)
        ends[end] += 1
        if not end.endswith(UNSTORED):
            ids.append((starter, id_))
        written = site.written(starter, since=received)
        site.check(written <= once[starter], f"{id_}: {starter} has received {written} for one start")
        await site.stop(starter)
    await _send_all_again(site, ids)
    frames = {name: len(ear.unit.start_frames) for name, ear in site.ears.items()}
    for name in STARTERS:
        site.check(frames[name] <= commanded[name], f"{name}: {frames[name]} start frames, {commanded}")
    site.measurements |= dict(sorted(ends.items()))
    site.measurements |= {"start frames": sum(frames.values()), "commanded": commanded.total()}


async def stops_at_start_up(site: CommandSite, count: int, seed: int) -> None:
    """Kill the gateway while a motor runs, and stop that as soon as the next one takes commands."""
    dice = random.Random(seed)
    frames_s, ends_s = [0.0], [0.0]
    for number in range(count):
        starter, lives = STARTERS[number % len(STARTERS)], len(site.gateway.lives)
        await site.ready((starter,))
        site.listener.command(starter, "start", f"run-{number}")
        run = await site.listener.final(f"run-{number}")
        site.check(run["phase"] == "confirmed", f"a start ended as {run}")
        site.gateway.signal(signal.SIGKILL)
        await site.gateway.until_up(lives=lives + 1)
        began_s = site.gateway.lives[-1].began_s
        await site.listener.until("gateway/status", since_s=began_s, within_s=20.0, state="online")
        await asyncio.sleep(dice.uniform(0.0, 0.2))
        sent_s = time.monotonic()
        await site.stop(starter)
        end_s = site.listener.received_s[f"result/{starter}/alice"] - sent_s
        written_s = [at_s for at_s, _ in site.ears[starter].writes() if at_s >= sent_s]
        frames_s.append(written_s[0] - sent_s)
        ends_s.append(end_s - frames_s[-1])
    site.check(max(frames_s) <= STOP_WITHIN_S, f"a stop's frame came after {max(frames_s):.2f} s")
    site.check(max(ends_s) <= CONFIRMED_WITHIN_S, f"a stop was confirmed {max(ends_s):.2f} s after its frame")
    site.measurements |= {"frame s": round(max(frames_s), 3), "confirmed s later": round(max(ends_s), 3)}


async def _clean_start(site: CommandSite, starter: str) -> Counter[bytes]:
    """Start and stop without any trouble; return what a start writes."""
    received = site.mark(starter)
    site.listener.command(starter, "start", f"{CLEAN}-{starter}")
    result = await site.listener.final(f"{CLEAN}-{starter}")
    site.check(result["phase"] == "confirmed", f"a start in peace ended as {result}")
    written = site.written(starter, since=received)
    await site.stop(starter)
    return written


async def _kill(site: CommandSite, starter: str, id_: str, dice: random.Random) -> str:
    """Command a start, kill, and ask the next life what became of it; return both in short."""
    frames = len(site.ears[starter].unit.start_frames)
    lives = len(site.gateway.lives)
    site.listener.command(starter, "start", id_)
    await asyncio.sleep(dice.uniform(*dice.choice(WINDOWS_S)))
    site.gateway.signal(signal.SIGKILL)
    await site.gateway.until_up(lives=lives + 1)
    if dice.random() < KILLED_AGAIN:
        await asyncio.sleep(dice.uniform(*RECOVERY_S))
        site.gateway.signal(signal.SIGKILL)
        await site.gateway.until_up(lives=lives + 2)
        site.measurements["killed again"] = site.measurements.get("killed again", 0) + 1
    began_s = site.gateway.lives[-1].began_s
    first_life = site.listener.of(id_)
    first_life = [each for each in first_life if each["code"] not in NOT_YET]
    await site.listener.until("gateway/status", since_s=began_s, within_s=20.0, state="online")
    await site.listener.until(f"starter/{starter}/state", since_s=began_s, within_s=20.0, quality="good")
    frames = len(site.ears[starter].unit.start_frames) - frames
    answer = await _ask_again(site, starter, id_)
    await _judge(site, id_, first_life, answer, frames)
    return f"{first_life[-1]['phase'] if first_life else 'nothing'}>{_short(answer)}"


async def _ask_again(site: CommandSite, starter: str, id_: str) -> dict[str, Any]:
    """Send the same id once more, twice where it was refused for now, and return the final answer."""
    for _ in range(2):
        since = len(site.listener.results)
        site.listener.command(starter, "start", id_)
        answer = await site.result(
            lambda each: (
                each["id"] == id_ and is_final(each) and (each["duplicate"] or each["code"] != "crashed")
            ),
            f"an answer to {id_}",
            since=since,
        )
        if answer["code"] not in UNSTORED or answer["duplicate"]:
            break
        await asyncio.sleep(PACE_S)
    return answer


async def _judge(
    site: CommandSite, id_: str, first_life: list[dict[str, Any]], answer: dict[str, Any], frames: int
) -> None:
    """Check one command's story: what both lives published, what the starter received."""
    site.check(frames <= 1, f"{id_}: {frames} start frames")
    story = f"{id_}: first {first_life}, then {answer}, {frames} start frames"
    if not answer["duplicate"]:
        site.check(not first_life and not frames, f"forgotten: {story}")
        return
    if answer["code"] == "crashed":
        await site.result(
            lambda each: each["id"] == id_ and each["code"] == "crashed" and not each["duplicate"],
            f"said unasked: {story}",
            within_s=15.0,
        )
        site.check(answer["phase"] in ("unconfirmed", "rejected"), f"not honest: {story}")
        site.check(answer["phase"] == "unconfirmed" or not frames, f"it was written: {story}")
    elif first_life and is_final(first_life[-1]):
        same = (first_life[-1]["phase"], first_life[-1]["code"]) == (answer["phase"], answer["code"])
        site.check(same, f"published differently: {story}")
    site.check(answer["phase"] != "confirmed" or frames == 1, f"never started: {story}")


async def _send_all_again(site: CommandSite, ids: list[tuple[str, str]]) -> None:
    """All ids once more: every one has its stored result, and nothing is written."""
    marks = {starter: site.mark(starter) for starter in STARTERS}
    since = len(site.listener.results)
    for starter, id_ in ids:
        site.listener.command(starter, "start", id_)
        await asyncio.sleep(PACE_S)
    for _, id_ in ids:
        await site.result(
            lambda each, id_=id_: each["id"] == id_ and each["duplicate"],  # type: ignore[misc] # a default
            f"{id_} is known",
            since=since,
        )
    for starter, mark in marks.items():
        written = site.written(starter, since=mark)
        site.check(not written, f"after repetitions {starter} received {written}")


def _short(answer: dict[str, Any]) -> str:
    again = "" if answer["duplicate"] else "new "
    return f"{again}{answer['phase']} {answer['code']}"
