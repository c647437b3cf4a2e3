"""`make bench`: the line at its physical limit, measured; `--only efficiency` for a part."""

from __future__ import annotations

import argparse
import os
import subprocess
import time

from tests.lab.bench.costs import cpu, start, stop, sweep
from tests.lab.bench.report import Goal, table
from tests.lab.bench.rows import BenchRow, dead, efficiency, judge
from tests.mosquitto import missing_programs

ROWS = {each.__name__: each for each in (judge, efficiency, dead, cpu, start, stop, sweep)}

QUIET = 0.3
BUSY = " (others use this machine: efficiency, stops and the start come out worse than they are)"


def main() -> int:
    """Measure what the command line names and print it; 1 when something was not reached."""
    parser = argparse.ArgumentParser(prog="python -m tests.lab.bench", description=__doc__)
    parser.add_argument("--only", choices=ROWS, action="append", help="may be given several times")
    args = parser.parse_args()
    begun_s = time.monotonic()
    load = os.getloadavg()[0]
    print(f"{os.cpu_count()} processors; load before: {load:.2f}{BUSY if load > QUIET else ''}\n", flush=True)
    if absent := missing_programs():
        print(f"Not installed: {', '.join(absent)} (apt-get install mosquitto mosquitto-clients)")
        return 1
    goals: list[Goal] = []
    for name in args.only or ROWS:
        try:
            row = ROWS[name]()
        except (RuntimeError, subprocess.SubprocessError) as error:  # the other rows are still worth having
            row = BenchRow(f"## {name}\n\n{error}\n", [Goal(f"{name}: ran to its end", 0, 1)])
        goals += row.goals
        print(row.text, flush=True)
    if goals:
        print(table("Reached", ["what", "got", "limit", ""], [goal.cells() for goal in goals]))
    missed = [goal for goal in goals if not goal.is_met]
    print(f"{len(goals) - len(missed)} of {len(goals)} met; {time.monotonic() - begun_s:.0f} s")
    return 1 if missed else 0


if __name__ == "__main__":
    raise SystemExit(main())
