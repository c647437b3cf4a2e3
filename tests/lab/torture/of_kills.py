"""SIGKILL around a start: never a second start frame, never a dishonest result."""

from __future__ import annotations

import asyncio
import signal
import time
from collections import Counter
from typing import Any

from tests.lab.torture.machine import until
from tests.lab.torture.recorder import is_final
from tests.lab.torture.scenario import COMMANDS, Scenario
from tests.lab.torture.world import PACE_S, STARTERS, STOP_WITHIN_S, World

# After publishing: before the ledger, around it, around the write, in the read-back, and after all.
WINDOWS_S = ((0.0, 0.004), (0.004, 0.02), (0.02, 0.1), (0.1, 0.4), (0.4, 1.2))
RECOVERY_S = (0.0, 1.5)  # after it is up again: before the end of what was cut short is published, and after
KILLED_AGAIN = 0.25  # of the times
UNSTORED = ("not_stored", "not_fresh")  # refusals that end with the run: the next one may take the id
NOT_YET = ("crashed", *UNSTORED)  # no answers to what is sent again
CONFIRMED_WITHIN_S = 1.5  # after a stop's frame: both readings, of motors that stop in a third of it

Results = list[dict[str, Any]]


async def kills(w: World, count: int) -> None:
    """Kill the gateway that many times, each time around the start of one of the starters."""
    once = {starter: await _clean_start(w, starter) for starter in STARTERS}
    ids: list[tuple[str, str]] = []
    ends: Counter[str] = Counter()
    for _ in range(count):
        starter, begun_s = w.dice.choice(tuple(STARTERS)), time.monotonic()
        id_, end = await _kill(w, starter)
        ends[end] += 1
        if not end.endswith(UNSTORED):
            ids.append((starter, id_))
        written = await w.written(starter, since_s=begun_s)
        w.check(written <= once[starter], f"{id_}: {starter} has received {written} for one start")
        await w.stand(starter)
    await _send_all_again(w, ids)
    # A stop's final does not wait for the disk: a crash right after it may add that the stop was cut short.
    w.recorder.results[:] = [
        each
        for each in w.recorder.results
        if each["code"] not in UNSTORED and (each["verb"], each["code"]) != ("stop", "crashed")
    ]
    frames = await w.starts()
    w.row.measurements |= dict(sorted(ends.items()))
    w.row.measurements |= {"start frames": sum(frames.values()), "commanded": sum(w.commanded.values())}


async def stops_at_start_up(w: World, count: int) -> None:
    """Kill the gateway while a motor runs, and stop that as soon as the next one takes commands."""
    ends_s = [0.0]
    for number in range(count):
        starter, lives = tuple(STARTERS)[number % len(STARTERS)], len(w.gateway.lives)
        await w.ready((starter,))
        await w.start(starter)
        w.gateway.signal(signal.SIGKILL)
        await w.gateway.until_up(lives=lives + 1)
        began_s = w.gateway.lives[-1].began_s
        await w.recorder.until("gateway/status", since_s=began_s, within_s=20.0, state="online")
        await asyncio.sleep(w.dice.uniform(0.0, 0.2))
        sent_s = time.monotonic()
        ends_s.append(await w.stand(starter) - sent_s - (w.stops_s or [0.0])[-1])
    frame_s, end_s = max(w.stops_s, default=99.0), max(ends_s)
    w.check(frame_s <= STOP_WITHIN_S, f"a stop's frame came after {frame_s:.2f} s")
    w.check(end_s <= CONFIRMED_WITHIN_S, f"a stop was confirmed {end_s:.2f} s after its frame")
    w.row.measurements |= {"frame s": round(frame_s, 3), "confirmed s later": round(end_s, 3)}


async def _clean_start(w: World, starter: str) -> Counter[str]:
    """Start and stop without any trouble; return what a start writes."""
    await w.ready((starter,))
    begun_s = time.monotonic()
    await w.start(starter)
    written = await w.written(starter, since_s=begun_s)
    await w.stand(starter)
    return written


async def _kill(w: World, starter: str) -> tuple[str, str]:
    """Command a start, kill, and ask the next life how it ended; return the id, and both answers in short."""
    frames, lives = (await w.starts())[starter], len(w.gateway.lives)
    id_ = w.begin_start(starter)
    await asyncio.sleep(w.dice.uniform(*w.dice.choice(WINDOWS_S)))
    w.gateway.signal(signal.SIGKILL)
    await w.gateway.until_up(lives=lives + 1)
    if w.dice.random() < KILLED_AGAIN:
        await asyncio.sleep(w.dice.uniform(*RECOVERY_S))
        w.gateway.signal(signal.SIGKILL)
        await w.gateway.until_up(lives=lives + 2)
        w.row.measurements["killed again"] = w.row.measurements.get("killed again", 0) + 1
    began_s = w.gateway.lives[-1].began_s
    first_life = [each for each in w.recorder.of(id_) if each["code"] not in NOT_YET]
    await w.recorder.until("gateway/status", since_s=began_s, within_s=20.0, state="online")
    await w.recorder.until(f"starter/{starter}/state", since_s=began_s, within_s=20.0, quality="good")
    frames = (await w.starts())[starter] - frames
    answer = await _ask_again(w, starter, id_)
    await _judge(w, id_, first_life, answer, frames)
    again = "" if answer["duplicate"] else "new "
    first = first_life[-1]["phase"] if first_life else "nothing"
    return id_, f"{first}>{again}{answer['phase']} {answer['code']}"


async def _ask_again(w: World, starter: str, id_: str) -> dict[str, Any]:
    """Send the same id once more, twice where it was refused for now, and return the final answer."""
    for _ in range(2):
        since = len(w.recorder.results)

        def answers(since: int = since) -> Results:
            finals = [each for each in w.recorder.of(id_, since=since) if is_final(each)]
            return [each for each in finals if each["duplicate"] or each["code"] != "crashed"]

        w.recorder.command(starter, "start", id_)
        await until(lambda: bool(answers()), f"an answer to {id_}", within_s=20.0)
        answer = answers()[0]
        if answer["code"] not in UNSTORED or answer["duplicate"]:
            break
        await asyncio.sleep(PACE_S)
    return answer


async def _judge(w: World, id_: str, first_life: Results, answer: dict[str, Any], frames: int) -> None:
    """Check one command's story: what both lives published, what the starter received."""
    w.check(frames <= 1, f"{id_}: {frames} start frames")
    story = f"{id_}: first {first_life}, then {answer}, {frames} start frames"
    if not answer["duplicate"]:
        w.check(not first_life and not frames, f"forgotten: {story}")
        return
    if answer["code"] == "crashed":

        def is_said() -> bool:
            return any(each["code"] == "crashed" and not each["duplicate"] for each in w.recorder.of(id_))

        await until(is_said, f"said unasked: {story}", within_s=15.0)
        w.check(answer["phase"] in ("unconfirmed", "rejected"), f"not honest: {story}")
        w.check(answer["phase"] == "unconfirmed" or not frames, f"it was written: {story}")
    elif first_life and is_final(first_life[-1]):
        same = (first_life[-1]["phase"], first_life[-1]["code"]) == (answer["phase"], answer["code"])
        w.check(same, f"published differently: {story}")
    w.check(answer["phase"] != "confirmed" or frames == 1, f"never started: {story}")


async def _send_all_again(w: World, ids: list[tuple[str, str]]) -> None:
    """All ids once more: every one has its stored result, and nothing is written."""
    since, since_s = len(w.recorder.results), time.monotonic()
    for starter, id_ in ids:
        w.recorder.command(starter, "start", id_)
        await asyncio.sleep(PACE_S)

    def unknown() -> set[str]:
        return {id_ for _, id_ in ids} - {
            each["id"] for each in w.recorder.results[since:] if each["duplicate"]
        }

    await until(lambda: not unknown(), "all ids are known", within_s=20.0)
    for starter in STARTERS:
        written = await w.written(starter, since_s=since_s)
        w.check(not written, f"after repetitions {starter} received {written}")


SCENARIOS = (
    Scenario("SIGKILL around a start", COMMANDS, kills, 200, 8, "times"),
    Scenario("stop at start-up", COMMANDS, stops_at_start_up, 50, 3, "times"),
)
