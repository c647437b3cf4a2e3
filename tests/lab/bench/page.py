"""What the status page costs the line: pairs of spans with and without pages and a scan of its doors.

In one run the gateway polls without a pause while its page is closed and
while sixteen streams and a client that tries its doors are there. The client is a process that yields.
"""

from __future__ import annotations

import itertools
import os
import random
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, suppress

from tests.lab.bench.account import Account, Stop, account, between, quantile, stops, sweeps_s
from tests.lab.bench.judge import Spec
from tests.lab.bench.plant import bench_site, operate
from tests.lab.bench.report import Goal, table
from tests.lab.bench.rows import BenchRow
from tests.lab.bench.runs import Run
from tests.lab.bench.subjects import Span

STREAMS = 16
PAIRS = 6
SPAN_S = 5.0
STOPS = 6  # in each span
SETTLED_S = 0.5  # after the client has come or gone
WARM_S = 6.0
UNITS = 32
MANY = 247
REQUESTS_PER_S = 200.0  # 10,000 in the six spans, with those that are slow
HEAD = [
    "",
    "efficiency",
    "worst tenth",
    "too soon",
    "requests",
    "stops",
    "beyond p50 ms",
    "most ms",
    "unasked s",
]


def page() -> BenchRow:
    """Efficiency, silences and stops with and without open pages; memory with 247 starters."""
    run, spans = _alternating(Spec(units=UNITS, family="ssw07"))
    rows, goals, found = [], [], {}
    for kind, times in spans.items():
        accounts = found[kind] = [account(between(run.seen, *each), run.law) for each in times]
        late = stops(run.seen, [each for each in run.span.stops if _is_in(each.at_s, times)], run.law)
        unasked_s = max(max(sweeps_s(between(run.seen, *each))) for each in times)
        rows.append([kind, *_cells(accounts, late), f"{unasked_s:.2f}"])
        goals.append(Goal(f"too soon: {kind}", sum(each.too_soon for each in accounts), 0, is_most=True))
        late_ms = max((each.excess_s for each in late), default=float("nan")) * 1e3
        goals.append(Goal(f"stop, beyond what it must wait: {kind}", late_ms, 5, is_most=True, unit=" ms"))
    pairs = zip(found["alone"], found["pages"], strict=True)
    ratios = [loaded.efficiency / calm.efficiency for calm, loaded in pairs]
    goals.append(Goal("efficiency, with pages / alone, median of pairs", quantile(ratios, 0.5), 0.995))
    mib = _memory_mib()
    goals.append(Goal(f"memory: {MANY} starters and {STREAMS} pages", mib, 95, is_most=True, unit=" MiB"))
    note = (
        f"{PAIRS} pairs of {SPAN_S:g} s, {UNITS} SSW-07s, 19200. Pages: {STREAMS} streams, and"
        f"\n{REQUESTS_PER_S:g} requests a second at the doors. With / alone: "
        f"{', '.join(f'{each:.4f}' for each in ratios)}."
        f"\n{MANY} starters and {STREAMS} pages: {mib:.1f} MiB at most."
    )
    return BenchRow(table("The status page's cost", HEAD, rows, note=note), goals)


def _alternating(spec: Spec) -> tuple[Run, dict[str, list[tuple[float, float]]]]:
    """Run the gateway; return what the judge saw, and the spans without and with pages."""
    spans: dict[str, list[tuple[float, float]]] = {"alone": [], "pages": []}
    submitted = []
    with bench_site(spec, has_page=True) as site:
        time.sleep(WARM_S)
        from_s = time.monotonic()
        for kind in ("alone", "pages") * PAIRS:
            with visited(site.page_port) if kind == "pages" else nullcontext():
                time.sleep(SETTLED_S)
                begun_s = time.monotonic()
                submitted += operate(site.broker_port, spec, seconds=SPAN_S, stops=STOPS)
                spans[kind].append((begun_s, time.monotonic()))
        span = Span(from_s, time.monotonic(), 0.0, site.process.used().most_kib, submitted)
        return site.judge.run(span), spans


def _memory_mib() -> float:
    with bench_site(Spec(units=MANY, family="ssw07", is_calm=True), has_page=True) as site:
        time.sleep(6.0 + 0.35 * MANY)  # all are identified first, and their settings looked at
        with visited(site.page_port):
            time.sleep(10.0)
            return site.process.used().most_kib / 1024


@contextmanager
def visited(port: int) -> Iterator[None]:
    """Let a client visit the page until the end."""
    client = subprocess.Popen(
        [sys.executable, "-m", "tests.lab.bench.page", str(port)], stdin=subprocess.PIPE
    )
    try:
        yield
    finally:
        client.communicate()


def visit(port: int) -> None:
    """Hold streams open and try the doors until the standard input ends."""
    os.nice(10)
    for number in range(STREAMS):
        watch(port, f"127.0.0.{2 + number // 4}")
    threading.Thread(target=_try_doors, args=(port,), daemon=True).start()
    sys.stdin.read()


def watch(port: int, address: str = "127.0.0.1") -> None:
    """Hold a stream of the page open, and read it, until the gateway ends."""

    def read() -> None:
        with suppress(OSError), _connected(port, address) as stream:
            stream.sendall(_request(port, "/api/v1/events"))
            while stream.recv(65536):
                pass

    threading.Thread(target=read, daemon=True).start()


def _try_doors(port: int) -> None:
    chance = random.Random(16)
    slow: list[socket.socket] = []
    whole = _request(port, "/api/v1/state")
    due_s = time.monotonic()
    for number in itertools.count():
        due_s += 1 / REQUESTS_PER_S
        time.sleep(max(due_s - time.monotonic(), 0.0))
        kinds = (
            _broken(whole, chance),
            _request(port, "/", "evil.example"),
            _request(port, "/" + "a" * 9000),
        )
        with suppress(OSError), _connected(port, "127.0.0.9") as client:
            if number % 50 == 0:  # one that never ends its head
                client.sendall(whole[:20])
                slow.append(client.dup())
                continue
            client.sendall(kinds[0] if number % 4 else kinds[1 + number // 4 % 2])
            client.shutdown(socket.SHUT_WR)
            client.recv(4096)
        for each in slow[:-20]:
            each.close()
            slow.remove(each)


def _broken(request: bytes, chance: random.Random) -> bytes:
    found = bytearray(request)
    for _ in range(chance.randint(1, 6)):
        found[chance.randrange(len(found))] = chance.randrange(256)
    return bytes(found)


def _connected(port: int, address: str) -> socket.socket:
    return socket.create_connection(("127.0.0.1", port), 10.0, source_address=(address, 0))


def _request(port: int, path: str, host: str = "") -> bytes:
    return f"GET {path} HTTP/1.1\r\nHost: {host or f'127.0.0.1:{port}'}\r\nAccept: */*\r\n\r\n".encode()


def _is_in(at_s: float, times: list[tuple[float, float]]) -> bool:
    return any(from_s <= at_s < to_s for from_s, to_s in times)


def _cells(accounts: list[Account], late: list[Stop]) -> list[str]:
    return [
        f"{quantile([each.efficiency for each in accounts], 0.5):.4f}",
        f"{quantile([each.efficiency_low for each in accounts], 0.5):.4f}",
        str(sum(each.too_soon for each in accounts)),
        str(sum(each.requests for each in accounts)),
        str(len(late)),
        f"{quantile([each.excess_s for each in late], 0.5) * 1e3:.1f}",
        f"{max((each.excess_s for each in late), default=float('nan')) * 1e3:.1f}",
    ]


if __name__ == "__main__":
    visit(int(sys.argv[1]))
