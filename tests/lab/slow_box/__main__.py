"""`python -m tests.lab.slow_box [--share 0.2]`: what the gateway meets with a fifth of a processor.

The bench's judge serves the starters at full speed, on pseudo terminals; all their motors run, every line is
asked without a pause.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from dataclasses import dataclass

from tests.lab.bench.account import account, between, quantile, stops
from tests.lab.bench.judge import Spec
from tests.lab.bench.page import watch
from tests.lab.bench.plant import bench_site
from tests.lab.bench.report import table
from tests.lab.slow_box.throttle import Throttle
from tests.mosquitto import missing_programs

SHARE = 0.2
SECONDS = 10.0
STOPS = 20
STREAMS = 4  # of the status page
SIZES = ((1, 8, False), (1, 32, False), (1, 32, True), (2, 32, False), (3, 32, False), (4, 32, False))


@dataclass(frozen=True)
class SlowRow:
    """What one size of a site gave."""

    lines: int
    starters: int
    has_page: bool
    first_s: float  # from the gateway's start to its first request
    per_s: float  # transactions of all lines
    efficiency: float  # the line's physical limit / elapsed, median
    whole: float  # the same, of the whole time
    too_soon: int  # silences broken
    stop_p50_s: float  # beyond the transaction under way
    stop_most_s: float
    stops: int
    used: float  # processor time, as a share of the share
    mib: float


def main() -> int:
    """Measure all sizes and print them; 1 when a silence was broken or a stop lost."""
    parser = argparse.ArgumentParser(prog="python -m tests.lab.slow_box", description=__doc__)
    parser.add_argument("--share", type=float, default=SHARE, help="of one processor")
    parser.add_argument("--size", action="append", metavar="LINES,STARTERS[,page]", help="only this")
    parser.add_argument("--seconds", type=float, default=SECONDS, help="of each size")
    args = parser.parse_args()
    if absent := missing_programs():
        print(f"not installed: {', '.join(absent)} (apt-get install mosquitto mosquitto-clients)")
        return 2
    sizes = [_size(text) for text in args.size] if args.size else SIZES
    with Throttle(args.share) as throttle:
        print(
            f"{os.cpu_count()} processors, load {os.getloadavg()[0]:.1f}; {throttle.how}\n",
            flush=True,
        )
        rows = []
        for lines, starters, has_page in sizes:
            rows.append(measure(throttle, lines, starters, seconds=args.seconds, has_page=has_page))
            print(f"{rows[-1]}, load {os.getloadavg()[0]:.1f}", flush=True)
    head = ["lines x starters", "first s", "per s", "efficiency", "whole", "too soon"]
    head += ["stop p50 ms", "most ms", "stops", "used", "MiB"]
    print(table(f"A {args.share:g} of a processor, 19200", head, [_cells(row) for row in rows]))
    return 1 if any(row.too_soon or row.stops < STOPS for row in rows) else 0


def measure(throttle: Throttle, lines: int, starters: int, *, seconds: float, has_page: bool) -> SlowRow:
    """Run the gateway within the share on saturated lines, with stops over MQTT."""
    spec = Spec(lines=lines, units=starters, family="ssw07")
    with bench_site(spec, has_page=has_page, starting=throttle.applied()) as site:
        # All are identified first, and their settings looked at.
        time.sleep(10.0 + 0.4 * starters * max(lines / 2, 1.0))
        for _ in range(STREAMS if has_page else 0):
            watch(site.page_port)
        span = site.measured(spec, warm_s=1.0, seconds=seconds, stops=STOPS)
        run = site.judge.run(span)
    seconds = span.to_s - span.from_s
    found, late = (
        account(run.seen, run.law),
        stops([each for each in run.seen if each.line == 0], span.stops, run.law),
    )
    per_s = len(between(run.seen, span.from_s, span.to_s)) / seconds
    return SlowRow(
        *(lines, starters, has_page, run.first_s - site.process.begun_s, per_s),
        *(found.efficiency, found.whole, found.too_soon),
        stop_p50_s=quantile([each.excess_s for each in late], 0.5),
        stop_most_s=max((each.excess_s for each in late), default=float("nan")),
        stops=len(late),
        used=span.cpu_s / seconds / throttle.share,
        mib=span.rss_kib / 1024,
    )


def _size(text: str) -> tuple[int, int, bool]:
    lines, starters, *page = text.split(",")
    return int(lines), int(starters), bool(page)


def _cells(row: SlowRow) -> list[str]:
    return [
        f"{row.lines} x {row.starters}{', page' if row.has_page else ''}",
        f"{row.first_s:.1f}",
        f"{row.per_s:.0f}",
        f"{row.efficiency:.3f}",
        f"{row.whole:.3f}",
        str(row.too_soon),
        f"{row.stop_p50_s * 1e3:.1f}",
        f"{row.stop_most_s * 1e3:.1f}",
        str(row.stops),
        f"{row.used:.0%}",
        f"{row.mib:.0f}",
    ]


if __name__ == "__main__":
    sys.exit(main())
