"""`python -m tests.lab.torture`: the gateway under every fault that we can think of; 1 when one fails.

--short takes some minutes, the whole some hours. A scenario's name, the beginning of one, or a place (crash,
broker, hang, port, disk, commands) runs only that.
"""

from __future__ import annotations

import argparse
import asyncio
import sys
from collections.abc import Callable
from typing import Any

from tests.lab.torture import noise, of_malformed
from tests.lab.torture.of_disk import may_mount
from tests.lab.torture.rig_row import RigScenario
from tests.lab.torture.runner import SCENARIOS, run_place
from tests.lab.torture.scenario import Much, Place, Row
from tests.mosquitto import missing_programs

IN_VIRTUAL_TIME: tuple[RigScenario, ...] = (*noise.SCENARIOS, *of_malformed.SCENARIOS)


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.lab.torture", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("names", nargs="*", help="what to run; without any, everything")
    parser.add_argument("--short", action="store_true", help="a little of each")
    parser.add_argument("--quick", action="store_true", help="the least, with real processes only")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, help="instead of the counts in the table")
    args = parser.parse_args()
    rows: list[Row] = []

    def report(row: Row) -> None:
        print("\n    ".join([str(row), *row.failures]), flush=True)
        rows.append(row)

    _run_all(args, report)
    failed = [row.name for row in rows if row.failures]
    print(f"\n{len(rows)} scenarios, {len(failed)} fail: {', '.join(failed) or 'none'}")
    return 1 if failed or not rows else 0


def _run_all(args: argparse.Namespace, report: Callable[[Row], None]) -> None:
    for place in Place:
        chosen = [
            each
            for each in SCENARIOS
            if each.place is place
            and (_is_wanted(each.name, args.names) or place.value in args.names)
            and (each.quick or not args.quick)
        ]
        if not chosen:
            continue
        if missing := missing_programs():
            report(Row(place.value, "-", [f"not installed: {', '.join(missing)}"]))
        elif place is Place.DISK and not may_mount():
            report(Row(place.value, "-", ["only root can mount a small disk"]))
        else:
            much = Much.QUICK if args.quick else Much.SHORT if args.short else Much.WHOLE
            how: dict[str, Any] = {"much": much, "seed": args.seed, "count": args.count}
            asyncio.run(run_place(place, chosen, report=report, **how))
    if args.quick:
        return
    for each in IN_VIRTUAL_TIME:
        if _is_wanted(each.name, args.names):
            report(each.row(args.count or (each.short if args.short else each.whole), args.seed))


def _is_wanted(name: str, names: list[str]) -> bool:
    return not names or any(name.startswith(each) for each in names)


if __name__ == "__main__":
    sys.exit(main())
