"""`python -m tests.lab.torture`: the gateway under every fault that we can think of; 1 when one fails.

--short takes some minutes, the whole some hours. A scenario's name, or the beginning of one, runs only that.
"""

from __future__ import annotations

import argparse
import asyncio
import logging
import sys
import time
from collections.abc import Callable, Iterable
from contextlib import AsyncExitStack
from pathlib import Path
from tempfile import TemporaryDirectory

from gateway.line.capacity.outage import Restart
from tests.lab.torture import of_broker, of_disk, of_kills, of_port, of_process, of_stale, on_the_rig
from tests.lab.torture.scenario import Place, Row, Scenario
from tests.lab.torture.supervisor import restart_of_unit
from tests.lab.torture.verdict import judge
from tests.lab.torture.world import World, world
from tests.mosquitto import missing_programs
from tests.rig import RigPlant
from tests.rig.sites import ALICE, FOUR, QUICK

SHORT_RESTART = Restart(restart_s=0.5, watchdog_s=3.0, abort_s=2.0, start_up_s=2.0)  # a hang ends sooner
PATIENT_RESTART = Restart(restart_s=0.1, watchdog_s=10.0, abort_s=2.0, start_up_s=2.0)
KNOWN_S = 5.0  # until all starters are online and identified
SCENARIOS: tuple[Scenario, ...] = sum(
    (each.SCENARIOS for each in (of_process, of_broker, of_port, of_disk, of_kills, of_stale, on_the_rig)), ()
)


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.lab.torture", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("names", nargs="*", help="what to run; without any, everything")
    parser.add_argument("--short", action="store_true", help="a little of each")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, help="instead of the counts in the table")
    args = parser.parse_args()
    places: dict[Place | None, list[Scenario]] = {}
    for each in SCENARIOS:
        if not args.names or each.name.startswith(tuple(args.names)):
            places.setdefault(each.place, []).append(each)
    rows: list[Row] = []

    def report(row: Row) -> None:
        print("\n    ".join([str(row), *row.failures]), flush=True)
        rows.append(row)

    for place, scenarios in places.items():
        if place is None:
            for each in scenarios:
                report(_on_rig(each, _count(each, args), args.seed))
        elif missing := missing_programs():
            report(Row("broker", "-", [f"not installed: {', '.join(missing)}"]))
        elif place.has_small_disk and not of_disk.may_mount():
            report(Row("disk", "-", ["only root can mount a small disk"]))
        else:
            asyncio.run(_in_world(place, scenarios, args, report))
    failed = [row.name for row in rows if row.failures]
    print(f"\n{len(rows)} scenarios, {len(failed)} fail: {', '.join(failed) or 'none'}")
    return 1 if failed or not rows else 0


def _count(scenario: Scenario, args: argparse.Namespace) -> int:
    return args.count or (scenario.short if args.short else scenario.whole)


def _on_rig(scenario: Scenario, count: int, seed: int) -> Row:
    """Try it on a plant of all four families in virtual time."""
    row = Row(scenario.name, f"{count} {scenario.unit}")
    began_s = time.monotonic()
    logging.disable(logging.WARNING)  # a bug is logged as an error, which the rig finds
    try:
        with RigPlant(FOUR + ALICE, sim=dict.fromkeys(on_the_rig.STARTERS, QUICK), seed=seed) as plant:
            plant.run(until=KNOWN_S)
            scenario.run(plant, row, count, seed)
    except AssertionError as error:
        row.check(False, str(error))
    finally:
        logging.disable(logging.NOTSET)
    row.took_s = time.monotonic() - began_s
    return row


async def _in_world(
    place: Place, scenarios: Iterable[Scenario], args: argparse.Namespace, report: Callable[[Row], None]
) -> None:
    """Run the scenarios of one place in one world."""
    restart = SHORT_RESTART if args.short else restart_of_unit()
    async with AsyncExitStack() as stack:
        made = TemporaryDirectory(prefix="torture-", ignore_cleanup_errors=True)
        folder = Path(stack.enter_context(made))
        if place.has_small_disk:
            stack.enter_context(of_disk.small_disk(folder / "state"))
        restart = PATIENT_RESTART if place.is_patient else restart
        here = await stack.enter_async_context(world(folder, restart, place, seed=args.seed))
        for each in scenarios:
            report(await _row(here, each, _count(each, args)))


async def _row(here: World, scenario: Scenario, count: int) -> Row:
    """Run one scenario and judge it."""
    here.row = Row(scenario.name, f"{count} {scenario.unit}")
    here.samples, here.stops_s = [], []
    await here.starters.order("mark")
    begun_s = time.monotonic()
    try:
        await scenario.run(here, count)
        await judge(here, begun_s=begun_s, may_trip=scenario.may_trip)
    except TimeoutError as error:
        here.check(False, str(error) or "something never came about")
    here.row.took_s = time.monotonic() - begun_s
    return here.row


if __name__ == "__main__":
    sys.exit(main())
