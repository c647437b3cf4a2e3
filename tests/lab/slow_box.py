"""`python -m tests.lab.slow_box [--share 0.2]`: what the gateway meets with a fifth of a processor.

The bench's judge serves the starters at full speed, on pseudo terminals; all their motors run, every line is
asked without a pause. A control group's quota lets a process run for SLICE_S at full speed and then wait; a
slower processor would spread the same work. What takes less than SLICE_S is therefore faster here than on a
slow box, the sum is the same. Only root may make such a group.
"""

from __future__ import annotations

import argparse
import os
import socket
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from tests.lab.bench.account import account, quantile, stops
from tests.lab.bench.judge import Spec
from tests.lab.bench.plant import bench_site
from tests.lab.bench.report import table
from tests.mosquitto import missing_programs

STOPS = 20
STREAMS = 4  # of the status page
SIZES = ("1,8", "1,32", "1,32,page", "2,32", "3,32", "4,32")
SLICE_S = 0.001  # the shortest quota that Linux takes
V2, V1 = Path("/sys/fs/cgroup"), Path("/sys/fs/cgroup/cpu")
JOIN = ("sh", "-c", 'echo $$ > "$0/cgroup.procs" && exec "$@"')  # the command that follows runs in a group
HEAD = ("lines x starters", "first s", "per s", "efficiency", "whole", "too soon", "stop p50 ms", "most ms")


def main() -> int:
    """Measure all sizes and print them; 1 when a silence was broken or a stop lost."""
    parser = argparse.ArgumentParser(prog="python -m tests.lab.slow_box", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--share", type=float, default=0.2, help="of one processor")
    parser.add_argument("--size", action="append", metavar="LINES,STARTERS[,page]", help="only this")
    parser.add_argument("--seconds", type=float, default=10.0, help="of each size")
    args = parser.parse_args()
    if absent := missing_programs():
        print(f"not installed: {', '.join(absent)} (apt-get install mosquitto mosquitto-clients)")
        return 2
    rows, is_right = [], True
    with throttled(args.share) as group:
        print(f"{os.cpu_count()} processors, load {os.getloadavg()[0]:.1f}; {' '.join(group[-1:])}")
        for size in args.size or SIZES:
            row, is_size_right = measure(size, args.share, group, seconds=args.seconds)
            rows.append(row)
            is_right &= is_size_right
            print(f"{row}, load {os.getloadavg()[0]:.1f}", flush=True)
    print(table(f"A {args.share:g} of a processor, 19200", [*HEAD, "stops", "used", "MiB"], rows))
    return 0 if is_right else 1


def measure(size: str, share: float, group: tuple[str, ...], *, seconds: float) -> tuple[list[str], bool]:
    """Run the gateway within the share on saturated lines, with stops; return a row, and if all is well."""
    lines, starters, *page = size.split(",")
    spec = Spec(lines=int(lines), units=int(starters), family="ssw07")
    with bench_site(spec, has_page=bool(page), prefix=group) as site:
        # All are identified first, and their settings looked at.
        time.sleep(10.0 + 0.4 * spec.units * max(spec.lines / 2, 1.0))
        for _ in range(STREAMS if page else 0):
            threading.Thread(target=_watch, args=(site.page_port,), daemon=True).start()
        span = site.measured(spec, warm_s=1.0, seconds=seconds, stops=STOPS)
        run = site.judge.run(span)
    seconds = span.to_s - span.from_s
    found = account(run.seen, run.law)
    late_s = [each.excess_s for each in stops([s for s in run.seen if s.line == 0], span.stops, run.law)]
    row = [
        f"{lines} x {starters}{', page' if page else ''}",
        f"{run.first_s - site.process.begun_s:.1f}",
        f"{len(run.seen) / seconds:.0f}",
        f"{found.efficiency:.3f}",
        f"{found.whole:.3f}",
        str(found.too_soon),
        f"{quantile(late_s, 0.5) * 1e3:.1f}",
        f"{quantile(late_s, 1.0) * 1e3:.1f}",
        str(len(late_s)),
        f"{span.cpu_s / seconds / share:.0%}",
        f"{span.rss_kib / 1024:.0f}",
    ]
    return row, not found.too_soon and len(late_s) == STOPS


@contextmanager
def throttled(share: float) -> Iterator[tuple[str, ...]]:
    """Give what a command must begin with to have this share; RuntimeError where there is no group for it."""
    if share >= 1.0:
        yield ()
        return
    period_us, quota_us = round(SLICE_S / share * 1e6), round(SLICE_S * 1e6)
    controls = V2 / "cgroup.controllers"
    if controls.exists() and "cpu" in controls.read_text().split():  # the weight: before other work
        top, limits = V2, {"cpu.max": f"{quota_us} {period_us}", "cpu.weight": "10000"}
    else:
        quota = {"cpu.cfs_period_us": period_us, "cpu.cfs_quota_us": quota_us}
        top, limits = V1, {**{name: str(us) for name, us in quota.items()}, "cpu.shares": "262144"}
    group = top / f"slow-box-{os.getpid()}"
    try:
        try:
            group.mkdir()
            for name, value in limits.items():
                (group / name).write_text(value)
        except OSError as error:
            raise RuntimeError("a share of a processor needs control groups, and root") from error
        yield (*JOIN, str(group))
    finally:
        for _ in range(50):
            with suppress(OSError):  # while a process in it is still ending
                group.rmdir()
                break
            time.sleep(0.1)


def _watch(port: int) -> None:
    """Hold a stream of the page open, and read it, until the gateway ends."""
    with suppress(OSError), socket.create_connection(("127.0.0.1", port), 10.0) as stream:
        stream.sendall(
            f"GET /api/v1/events HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nAccept: */*\r\n\r\n".encode()
        )
        while stream.recv(65536):
            pass


if __name__ == "__main__":
    sys.exit(main())
