"""`python -m tests.lab.slow_box [--share 0.2]`: what the gateway meets with a fifth of a processor.

The bench's judge serves the starters at full speed, on pseudo terminals; all their motors run, every line is
asked without a pause.
"""

from __future__ import annotations

import argparse
import os
import socket
import sys
import tempfile
import threading
import time
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path

from tests.lab.bench.account import account, between, quantile, stops
from tests.lab.bench.judge import Spec
from tests.lab.bench.plant import bench_broker, operate, site
from tests.lab.bench.report import table
from tests.lab.bench.runs import Watched, gateway
from tests.lab.bench.subjects import Span
from tests.lab.slow_box.throttle import Throttle
from tests.mosquitto import free_port, missing_programs

SHARE = 0.2
SECONDS = 10.0
STOPS = 20
STREAMS = 4  # of the status page
END_S = 20.0
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
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        broker = stack.enter_context(bench_broker(folder))
        judge = stack.enter_context(Watched(spec))
        text, page = site(spec, judge.ports, broker.url), free_port()
        if has_page:
            text += f'[web]\nlisten = "127.0.0.1:{page}"\n'
        (folder / "site.toml").write_text(text, "utf-8")
        with throttle.applied():
            process = stack.enter_context(gateway(folder / "site.toml"))
        throttle.add(process.pid)
        time.sleep(
            10.0 + 0.4 * starters * max(lines / 2, 1.0)
        )  # all are identified first, and their settings looked at
        if has_page:
            stack.enter_context(_Watching(page))
        time.sleep(1.0)
        from_s, cpu_s = time.monotonic(), process.cpu_s()
        submitted = operate(broker.port, spec, seconds=seconds, stops=STOPS)
        span = Span(from_s, time.monotonic(), process.cpu_s() - cpu_s, process.rss_kib(), submitted)
        run = judge.run(span)
    seconds = span.to_s - span.from_s
    found, late = (
        account(run.seen, run.law),
        stops([each for each in run.seen if each.line == 0], submitted, run.law),
    )
    per_s = len(between(run.seen, span.from_s, span.to_s)) / seconds
    return SlowRow(
        *(lines, starters, has_page, run.first_s - process.begun_s, per_s),
        *(found.efficiency, found.whole, found.too_soon),
        stop_p50_s=quantile([each.excess_s for each in late], 0.5),
        stop_most_s=max((each.excess_s for each in late), default=float("nan")),
        stops=len(late),
        used=span.cpu_s / seconds / throttle.share,
        mib=span.rss_kib / 1024,
    )


class _Watching:
    """Streams of the status page that are read while the context lasts."""

    def __init__(self, port: int) -> None:
        self._port = port
        self._sockets: list[socket.socket] = []

    def __enter__(self) -> None:
        for _ in range(STREAMS):
            stream = socket.create_connection(("127.0.0.1", self._port), 20.0)
            head = f"GET /api/v1/events HTTP/1.1\r\nHost: 127.0.0.1:{self._port}\r\nAccept: */*\r\n\r\n"
            stream.sendall(head.encode())
            self._sockets.append(stream)
            threading.Thread(target=_drain, args=(stream,), daemon=True).start()

    def __exit__(self, *_: object) -> None:
        for each in self._sockets:
            with suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)


def _drain(stream: socket.socket) -> None:
    with suppress(OSError), stream:
        while stream.recv(65536):
            pass


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
