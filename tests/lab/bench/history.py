"""`python -m tests.lab.bench.history year|simultaneous|cost|line|demo`: the numbers in docs/history.md.

`year` is a whole year of 20 starts a day of 32 starters, with trips and counters, in one database on the disk
of this machine, in simulated time: an hour or less. `line` and `demo` are in real time, and want a machine
that does nothing else. These and the others take some minutes.
"""

from __future__ import annotations

import asyncio
import gc
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from gateway.storage.database import Database
from gateway.storage.history import FILE, HistoryStore
from gateway.system.gc_tuning import use_one_arena
from tests.lab.bench.history_cost import cost
from tests.lab.bench.history_demo import ROUNDS, demo_starts
from tests.lab.bench.history_line import history_line
from tests.lab.bench.history_mills import Mills
from tests.lab.bench.history_simultaneous import deviations
from tests.lab.bench.report import table
from tests.virtual_time import run_virtually

STARTERS = 32
STARTS_A_DAY = 20
AT_THE_SAME_TIME = 4  # starts whose records are written together
STARTS_FOR_A_TRIP = 200  # three trips of each starter in a month
DAYS = 365
DAY_S = 86_400.0
STATM = Path("/proc/self/statm")
PAGE_KB = 4
AT_ONCE = (1, 2, 4, 8, 15)


async def year(days: int) -> None:
    """Print disk, memory and the longest transaction, every 30 days and at the end."""
    longest_s, transactions = 0.0, 0  # no list of them: it would be most of what grows
    transact: Any = Database.transact

    def timed(self: Database, works: Sequence[Callable[..., Any]], *, is_flushed: bool = True) -> list[Any]:
        nonlocal longest_s, transactions
        begun_s = time.perf_counter()
        try:
            return list(transact(self, works, is_flushed=is_flushed))
        finally:
            longest_s, transactions = max(longest_s, time.perf_counter() - begun_s), transactions + 1

    Database.transact = timed  # type: ignore[method-assign] # only here
    use_one_arena()  # as `run` does
    with tempfile.TemporaryDirectory() as folder:  # what is there once: profiles, the readings, SQLite
        warm_up = Mills(HistoryStore(Path(folder), on_news=lambda *_: None), 1)
        await warm_up.begin()
        warm_up.start("mill-0")
        warm_up.trip("mill-0")
        await warm_up.service.close()
    del warm_up
    gc.collect()
    before_kb = most_kb = _memory_kb()
    with tempfile.TemporaryDirectory() as folder:
        store = HistoryStore(Path(folder), on_news=lambda *_: None)
        mills = Mills(store, STARTERS)
        await mills.begin()
        most_disk_mb, last = 0.0, days * STARTS_A_DAY - 1
        for number in range(last + 1):
            mills.clock.at_s = number * DAY_S / STARTS_A_DAY
            for index, name in enumerate(mills.names):
                mills.start(name)
                if (number + 7 * index) % STARTS_FOR_A_TRIP == 0:
                    mills.trip(name)
                if index % AT_THE_SAME_TIME == 0:
                    await mills.service.flushed()
            most_kb = max(most_kb, _memory_kb())
            most_disk_mb = max(most_disk_mb, _disk_mb(folder))
            if number % (30 * STARTS_A_DAY) == 0 or number == last:
                most_mb = (most_kb - before_kb) / 1024
                print(
                    f"day {number // STARTS_A_DAY + 1:3}: {mills.sink.starts} starts, {mills.sink.trips} "
                    f"trips, at most {most_disk_mb:.1f} MB of disk and {most_mb:.1f} MB more memory, "
                    f"longest transaction {1000 * longest_s:.0f} ms of {transactions}",
                    flush=True,
                )
        await mills.service.flushed()
        await mills.service.close()
        assert mills.sink.starts == days * STARTS_A_DAY * STARTERS


def simultaneous() -> None:
    """Print how exact records are by the number of motors of a line that start at once."""
    print("| starts at once | given by | samples/s | time off | said | I²t off | said | peak off |")
    print("|---|---|---|---|---|---|---|---|")
    for is_ours in (True, False):
        for count in AT_ONCE:
            found = run_virtually(deviations(count, is_ours=is_ours))
            i2t = [each.i2t_pct for each in found if each.i2t_pct is not None]
            said = [each.i2t_within_pct for each in found if each.i2t_within_pct is not None]
            cells = (
                f"{count}",
                "commands" if is_ours else "keypads",
                f"{min(each.rate_hz for each in found):.1f}",
                f"{max(each.acceleration_pct for each in found):.1f} %",
                f"{max(each.within_s for each in found):.2f} s",
                f"{max(i2t):.1f} %" if i2t else "-",
                f"{max(said):.0f} %" if said else "-",
                f"{max(each.peak_pct for each in found):.1f} %",
            )
            print(f"| {' | '.join(cells)} |", flush=True)


def costs() -> None:
    """Print what the history costs the line."""
    for has_history in (False, True):
        print(run_virtually(cost(has_history=has_history)))


def _disk_mb(folder: str) -> float:
    return sum(path.stat().st_size for path in Path(folder).glob(f"{FILE}*")) / 2**20


def _memory_kb() -> int:
    return int(STATM.read_text("ascii").split()[1]) * PAGE_KB


def main() -> int:
    """Print what is asked for."""
    what = sys.argv[1:2]
    if what == ["year"]:
        asyncio.run(year(int(sys.argv[2]) if len(sys.argv) > 2 else DAYS))
    elif what == ["simultaneous"]:
        simultaneous()
    elif what == ["cost"]:
        costs()
    elif what == ["line"]:
        row = history_line()
        print(row.text)
        print(table("Reached", ["what", "got", "limit", ""], [goal.cells() for goal in row.goals]))
    elif what == ["demo"]:
        asyncio.run(demo_starts(int(sys.argv[2]) if len(sys.argv) > 2 else ROUNDS))
    else:
        print(__doc__, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
