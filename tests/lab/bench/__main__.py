"""`make bench`: the line at its physical limit, measured; `--only efficiency` for a part."""

from __future__ import annotations

import argparse
import os
import subprocess
import time
from pathlib import Path

from tests.lab.bench.costs import cpu, start, stop, sweep
from tests.lab.bench.page import page
from tests.lab.bench.pictures import efficiency_picture, line_time_picture
from tests.lab.bench.report import Goal, table
from tests.lab.bench.rows import (
    MASTERS,
    BenchRow,
    dead,
    efficiencies,
    efficiency,
    judge,
    measured,
    spec_of,
)
from tests.mosquitto import missing_programs

ROWS = {each.__name__: each for each in (judge, efficiency, dead, cpu, start, stop, sweep, page)}

QUIET = 0.3
BUSY = " (others use this machine: efficiency, stops and the start come out worse than they are)"


def main() -> int:
    """Measure what the command line names, print it, draw it; 1 when something was not reached."""
    parser = argparse.ArgumentParser(prog="python -m tests.lab.bench", description=__doc__)
    parser.add_argument("--only", choices=ROWS, action="append", help="may be given several times")
    parser.add_argument("--pictures", type=Path, metavar="FOLDER", help="draw what `efficiency` measures")
    args = parser.parse_args()
    begun_s = time.monotonic()
    load = os.getloadavg()[0]
    print(f"{os.cpu_count()} processors; load before: {load:.2f}{BUSY if load > QUIET else ''}\n", flush=True)
    if absent := missing_programs():
        print(f"Not installed: {', '.join(absent)} (apt-get install mosquitto mosquitto-clients)")
        return 1
    goals: list[Goal] = []
    is_broken = False
    for name in args.only or ROWS:
        try:
            row = ROWS[name]()
        except (RuntimeError, subprocess.SubprocessError) as error:  # the other rows are still worth having
            is_broken = True
            row = BenchRow(f"## {name}\n\n{error}\n", [Goal(f"{name}: ran to its end", 0, 1)])
        goals += row.goals
        print(row.text, flush=True)
    if goals:
        print(table("Reached", ["what", "got", "limit", ""], [goal.cells() for goal in goals]))
    missed = [goal for goal in goals if not goal.is_met]
    if args.pictures is not None and not is_broken:
        _draw(args.pictures)
    print(f"{len(goals) - len(missed)} of {len(goals)} met; {time.monotonic() - begun_s:.0f} s")
    return 1 if missed else 0


def _draw(folder: Path) -> None:
    (folder / "efficiency.svg").write_text(efficiency_picture(efficiencies()), "utf-8")
    runs = {master: measured(master, spec_of(master)) for master in MASTERS}
    traces = {master: (run.seen, run.law) for master, run in runs.items()}
    (folder / "line-time.svg").write_text(line_time_picture(traces), "utf-8")


if __name__ == "__main__":
    raise SystemExit(main())
