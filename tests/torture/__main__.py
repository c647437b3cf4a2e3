"""`python -m tests.torture`: the gateway under every fault that we can think of; exit 1 when something fails.

--short takes some minutes, the whole some hours. A scenario's name, the beginning of one, or a place (crash,
broker, hang, port, disk, log) runs only that.
"""

from __future__ import annotations

import argparse
import asyncio
import sys

from tests.mosquitto import missing_programs
from tests.torture import fuzz, noise, of_commands, soak
from tests.torture.of_disk import may_mount
from tests.torture.runner import SCENARIOS, run_place
from tests.torture.scenario import Place, Row


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.torture", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("names", nargs="*", help="what to run; without any, everything")
    parser.add_argument("--short", action="store_true", help="a little of each")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, help="instead of the counts in the table")
    args = parser.parse_args()
    rows: list[Row] = []
    for row in _rows(args):
        print(row, flush=True)
        for failure in row.failures:
            print(f"    {failure}", flush=True)
        rows.append(row)
    failed = [row.name for row in rows if row.failures]
    print(f"\n{len(rows)} scenarios, {len(failed)} fail: {', '.join(failed) or 'none'}")
    return 1 if failed or not rows else 0


def _rows(args: argparse.Namespace):  # type: ignore[no-untyped-def] # rows, as they come
    for place in Place:
        chosen = [
            each
            for each in SCENARIOS
            if each.place is place and (_is_wanted(each.name, args.names) or place.value in args.names)
        ]
        if not chosen:
            continue
        if missing := missing_programs():
            yield Row(place.value, "-", [f"not installed: {', '.join(missing)}"])
        elif place is Place.DISK and not may_mount():
            yield Row(place.value, "-", ["only root can mount a small disk"])
        else:
            yield from asyncio.run(
                run_place(place, chosen, is_short=args.short, seed=args.seed, count=args.count)
            )
    for each in (*noise.SCENARIOS, *fuzz.SCENARIOS, *soak.SCENARIOS, *of_commands.SCENARIOS):
        if _is_wanted(each.name, args.names):
            yield each.row(args.count or (each.short if args.short else each.whole), args.seed)


def _is_wanted(name: str, names: list[str]) -> bool:
    return not names or any(name.startswith(each) for each in names)


if __name__ == "__main__":
    sys.exit(main())
