"""`python -m tests.lab.peers`: the same faults for this gateway, modpoll and an ordinary script; a table.

It takes some ten minutes, and installs modpoll into an environment of its own in the temporary folder. Words
choose faults that contain one of them. Where that is allowed (root), everything has real-time priority, so
that what else the machine does is not measured.
"""

from __future__ import annotations

import argparse
import asyncio
import os
import sys
import tempfile
from importlib.metadata import version
from pathlib import Path

from tests.lab.peers.bout import Score, bout
from tests.lab.peers.contenders import MODPOLL, Contender, Modpoll, contenders
from tests.lab.peers.faults import FAULTS, Fault
from tests.mosquitto import missing_programs

HOME = Path(tempfile.gettempdir()) / "starter-gateway-modpoll"


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.lab.peers", description=__doc__)
    parser.add_argument("words", nargs="*", help="only faults with one of these words; without any, all")
    parser.add_argument("--at-once", type=int, default=2, help="how many bouts may share the machine")
    args = parser.parse_args()
    if missing := missing_programs():
        print(f"not installed: {', '.join(missing)}", file=sys.stderr)
        return 1
    faults = [each for each in FAULTS if not args.words or any(word in each.name for word in args.words)]
    compared = contenders(HOME)
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(10))
    except PermissionError:
        print("without real-time priority: a busy machine shows in the measurements", file=sys.stderr)
    scores = asyncio.run(_all(compared, faults, args.at_once))
    print(table(compared, faults, scores))
    (theirs,) = HOME.glob("lib/python*/site-packages/pymodbus-*.dist-info")
    own = f"pymodbus {version('pymodbus')}, paho-mqtt {version('paho-mqtt')}"
    print(f"\n{MODPOLL} with {theirs.stem}; script: {own}")
    print(f"the starters were late {sum(score.late for score in scores.values())} times")
    return 0


async def _all(
    compared: tuple[Contender, ...], faults: list[Fault], at_once: int
) -> dict[tuple[str, str], Score]:
    """Run every bout, a few at a time."""
    slots = asyncio.Semaphore(at_once)
    scores: dict[tuple[str, str], Score] = {}

    async def one(contender: Contender, fault: Fault) -> None:
        try:
            async with slots, bout(contender, every_s=fault.every_s) as here:
                await fault.happen(here)
                score = scores[contender.name, fault.name] = await here.score()
        except TimeoutError as error:
            print(f"{fault.name} | {contender.name} | {error}", file=sys.stderr, flush=True)
            return
        lateness = f"starters late {score.late} times" if score.late else ""
        print(f"{fault.name} | {contender.name} | {cell(score)} {lateness}", file=sys.stderr, flush=True)
        for text in (*score.wrong[:3], *score.unreadable):
            print(f"    {text}", file=sys.stderr, flush=True)

    pairs = [(contender, fault) for fault in faults for contender in compared if _is_for(contender, fault)]
    async with asyncio.TaskGroup() as group:
        for contender, fault in pairs:
            group.create_task(one(contender, fault))
    return scores


def _is_for(contender: Contender, fault: Fault) -> bool:
    """Return whether a contender takes part: the corrected one only where something is written."""
    return fault.is_about_writes or not (isinstance(contender, Modpoll) and contender.is_corrected)


def table(compared: tuple[Contender, ...], faults: list[Fault], scores: dict[tuple[str, str], Score]) -> str:
    """Return all scores as a table in Markdown."""
    rows = [["fault", *(each.name for each in compared)], ["---"] * (1 + len(compared))]
    for fault in faults:
        rows.append([fault.name])
        for each in compared:
            score = scores.get((each.name, fault.name))
            missing = "did not get going" if _is_for(each, fault) else "as modpoll"
            rows[-1].append(missing if score is None else cell(score))
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def cell(score: Score) -> str:
    """Return a score in few words; what is nought is left out."""
    parts = [f"lost {score.lost} of {score.possible}", f"stall {score.stall_s:.1f} s"]
    parts += [f"old as good {score.old_s:.1f} s"]
    if score.stale_starts is not None:
        parts.append(f"stale starts {score.stale_starts}")
    if score.stops_s:
        reached = sorted(each for each in score.stops_s if each is not None)
        never = len(score.stops_s) - len(reached)
        if reached:
            parts.append(f"stop {reached[len(reached) // 2]:.2f} s, at most {reached[-1]:.2f} s")
        parts += [f"{never} of {len(score.stops_s)} stops never on the wire"] if never else []
    for count, what in (
        (score.trips, "watchdog trips"),
        (len(score.wrong), "wrong as good"),
        (score.too_soon, "requests too soon"),
        (score.crossed, "requests crossed by a reply"),
        (score.deaths, "crashes"),
    ):
        parts += [f"**{count} {what}**"] if count else []
    return "; ".join(parts)


if __name__ == "__main__":
    sys.exit(main())
