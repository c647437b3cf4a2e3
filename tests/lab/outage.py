"""What an outage of the broker costs, and how much is written to the disk before, during and after it.

python -m tests.lab.outage [--units 247] [--away 600] [--connected 150] [--stops 30] [--standing]

The whole gateway polls simulated SSW-07s without a pause. Of each span: requests a second, processor time of
a request, memory, and what the process had written to its disk (/proc/PID/io; the file system's own journal
is not in it). A subscriber whose session outlives the broker's restart looks at the order of the history.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import paho.mqtt.client as paho

from tests.lab.bench.account import SeenRequest
from tests.lab.bench.judge import Spec
from tests.lab.bench.plant import BASE, BenchSite, bench_site, operate
from tests.listener import BrokerListener

QUIET_S = 10.0  # without a message of the history, the outage is drained
DRAIN_WITHIN_S = 400.0
LOOK_EVERY_S = 1.0
STOP_EVERY_S = 3.0


@dataclass
class Phase:
    """What happened in a span of time."""

    name: str
    from_s: float
    to_s: float = 0.0
    cpu_s: float = 0.0
    written: int = 0  # bytes
    rss_kib: list[int] = field(default_factory=list)  # every second

    def cells(self, seen: list[SeenRequest]) -> str:
        """Return a line of the table; `seen` are the requests of the whole run."""
        seconds = self.to_s - self.from_s
        requests = sum(self.from_s <= each.start_s < self.to_s for each in seen)
        ms = self.cpu_s * 1e3 / max(requests, 1)
        first, most, last = self.rss_kib[0] / 1024, max(self.rss_kib) / 1024, self.rss_kib[-1] / 1024
        kb_an_hour = self.written / seconds * 3.6
        return (
            f"{self.name:10} {seconds:6.0f} s  {requests / seconds:6.2f} requests/s  {ms:5.2f} ms"
            f"  MiB first, most, last {first:.1f} {most:.1f} {last:.1f}"
            f"  {self.written} bytes, {kb_an_hour:.0f} kB an hour"
        )


class OutageListener(BrokerListener):
    """Takes everything of the gateway; its session outlives the broker's restart."""

    def __init__(self, port: int) -> None:
        super().__init__(port, f"{BASE}/#", "outage")
        self.kinds: Counter[str] = Counter()
        self.gaps: list[str] = []
        self.items = self.disorder = 0
        self.history_s = self.first_s = 0.0  # when the last and the first of it came
        self._latest: dict[tuple[str, str], int] = {}  # seq by topic and point
        self.start()

    def take(self, message: paho.MQTTMessage) -> None:
        kind = "/".join(message.topic.removeprefix(f"{BASE}/").split("/")[:3:2])
        self.kinds[kind] += 1
        if message.topic.endswith("/history"):
            now_s = time.monotonic()
            self.first_s, self.history_s = self.first_s or now_s, now_s
            for item in json.loads(message.payload)["items"]:
                place = (message.topic, item["point"])
                self.items += 1
                self.disorder += item["seq"] <= self._latest.get(place, -1)
                self._latest[place] = item["seq"]
        elif b'"gap"' in message.payload:
            self.gaps.append(message.payload.decode())


def main() -> None:
    """Run it and print what was found."""
    parser = argparse.ArgumentParser(prog="python -m tests.lab.outage", description=__doc__)
    parser.add_argument("--units", type=int, default=247)
    parser.add_argument("--away", type=float, default=600.0, help="s; 0: no outage")
    parser.add_argument("--connected", type=float, default=150.0, help="s")
    parser.add_argument("--stops", type=int, default=30)
    parser.add_argument("--standing", action="store_true", help="motors at a standstill: nothing changes")
    args = parser.parse_args()
    spec = Spec(units=args.units, family="ssw07", is_calm=True, is_standing=args.standing)
    print(f"load before: {os.getloadavg()[0]:.2f}", flush=True)
    with bench_site(spec, is_persistent=True) as site:
        listener = OutageListener(site.broker_port)
        stops = partial(operate, site.broker_port, spec, seconds=args.stops * STOP_EVERY_S, stops=args.stops)
        phases = [_phase(site, "start", _after(10.0 + 0.35 * args.units))]
        phases.append(_phase(site, "connected", _after(args.connected)))
        if args.stops:
            phases.append(_phase(site, "stops", _after(args.stops * STOP_EVERY_S), stops))
        if args.away:
            phases += _outage(site, listener, args.away)
        phases.append(_phase(site, "after", _after(min(args.connected, 30.0))))
        listener.stop()
        files = (path for path in (site.folder / "state").rglob("*") if path.is_file())
        folder = sorted((path.name, path.stat().st_size) for path in files)
        seen = site.judge.seen()
    print(f"load after: {os.getloadavg()[0]:.2f}")
    for phase in phases:
        print(phase.cells(seen))
    print(
        f"history: {listener.items} values, {listener.disorder} out of order; gaps: {listener.gaps or 'none'}"
    )
    print(f"messages: {dict(listener.kinds.most_common(14))}")
    print(f"state_dir at the end: {folder}")


def _outage(site: BenchSite, listener: OutageListener, away_s: float) -> list[Phase]:
    def is_drained(from_s: float) -> bool:
        quiet_s = max(listener.history_s, from_s + 20.0) + QUIET_S
        return time.monotonic() > min(quiet_s, from_s + DRAIN_WITHIN_S)

    away = _phase(site, "away", _after(away_s), site.broker.stop)
    drain = _phase(site, "drain", is_drained, site.broker.start)
    drained_s, first_s = listener.history_s - listener.first_s, listener.first_s - drain.from_s
    print(f"history came for {drained_s:.0f} s, from {first_s:.1f} s after the return on")
    return [away, drain]


def _phase(
    site: BenchSite, name: str, is_over: Callable[[float], bool], do: Callable[[], object] = lambda: None
) -> Phase:
    """Do something, and look at the process every second until the phase is over, given when it began."""
    used, written = site.process.used(), _written(site.process.pid)
    phase = Phase(name, time.monotonic(), rss_kib=[used.rss_kib])
    do()
    while not is_over(phase.from_s):
        time.sleep(LOOK_EVERY_S)
        phase.rss_kib.append(site.process.used().rss_kib)
    phase.to_s = time.monotonic()
    phase.cpu_s = site.process.used().cpu_s - used.cpu_s
    phase.written = _written(site.process.pid) - written
    print(f"{phase.name} is over", flush=True)
    return phase


def _after(seconds: float) -> Callable[[float], bool]:
    return lambda from_s: time.monotonic() >= from_s + seconds


def _written(pid: int) -> int:
    lines = Path(f"/proc/{pid}/io").read_text("ascii").splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("write_bytes"))


if __name__ == "__main__":
    main()
