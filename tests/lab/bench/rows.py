"""Rows of the bench about the silence: how exact the judge is, efficiency, offline starters."""

from __future__ import annotations

from bisect import bisect
from dataclasses import dataclass, field
from functools import cache

from tests.lab.bench.account import Account, account, quantile
from tests.lab.bench.judge import Spec
from tests.lab.bench.plant import run_gateway
from tests.lab.bench.report import Goal, table
from tests.lab.bench.runs import Run, run_subject

BAUDS = (9600, 19200, 57600)
LIMITS = {9600: 0.99, 19200: 0.985, 57600: 0.98}
MASTERS = ("line", "gateway")
HEAD = ("efficiency", "worst tenth", "idle us", "too soon", "requests", "CPU ms")


@dataclass
class BenchRow:
    """What one part of the bench found."""

    text: str
    goals: list[Goal] = field(default_factory=list)


@cache
def measured(master: str, spec: Spec, warm_s: float = 0.7, seconds: float = 3.0) -> Run:
    """Run a master once; asked again, the same run serves."""
    if master == "gateway":
        return run_gateway(spec, warm_s=max(warm_s, 2.5), seconds=seconds)
    return run_subject(master, spec, warm_s=warm_s, seconds=seconds)


def cells(run: Run) -> list[str]:
    """Return a run in the columns of `HEAD`."""
    found = account(run.seen, run.law)
    return [
        f"{found.efficiency:.4f}",
        f"{found.efficiency_low:.4f}",
        _us(found.idle_s),
        str(found.too_soon),
        str(found.requests),
        f"{run.cpu_s * 1e3:.2f}",
    ]


def judge() -> BenchRow:
    """How exact the judge is: a master that never sleeps notes when it writes and when it can read."""
    rows = []
    for is_bytewise in (False, True):
        run = run_subject("pinger", Spec(units=1, is_bytewise=is_bytewise), seconds=3.0)
        samples = ([each.late_s for each in run.seen], *_ways_s(run))
        found = [_us(quantile(values_s, share)) for values_s in samples for share in (0.5, 0.99)]
        rows.append(["byte by byte" if is_bytewise else "one chunk", str(len(run.seen)), *found])
    head = ["reply", "requests", "handed over late p50", "p99", "way in p50", "p99", "way out p50", "p99"]
    note = (
        "Microseconds. Way in: from the master's write() to the time that counts as the request's start;"
        "\nway out: from the reply's handing over until it can be read. Both count against every master."
    )
    return BenchRow(table("The judge itself", head, rows, note=note))


def efficiency() -> BenchRow:
    """A saturated line of eight, at three speeds."""
    rows, goals = [], []
    for baud in BAUDS:
        for is_bytewise in (False, True):
            for master in MASTERS:
                run = measured(master, spec_of(master, baud=baud, is_bytewise=is_bytewise))
                what = f"{master} {baud} {'bytes' if is_bytewise else 'chunk'}"
                found = account(run.seen, run.law)
                rows.append([what, *cells(run)])
                goals += _goals(what, found, LIMITS[baud])
    note = (
        "Eight starters that answer after 5 ms. Ten registers; the gateway, which decodes and publishes to a"
        "\nMosquitto, reads SSW900s: 6, 7 and 24 registers. Efficiency: physical limit / elapsed, median of"
        "\ntransactions; above 1 the silence was broken. Idle: beyond the silence, which above 19200 is the"
        "\n2.005 ms of the starters' manuals."
    )
    return BenchRow(table("Efficiency", ["master", *HEAD], rows, note=note), goals)


def spec_of(master: str, *, baud: int = 19200, is_bytewise: bool = False) -> Spec:
    """Return the line for a master; the gateway gets starters, the line alone ten registers a unit."""
    family = "ssw900" if master == "gateway" else ""
    return Spec(baud=baud, is_bytewise=is_bytewise, family=family)


def dead() -> BenchRow:
    """The same with starters that do not answer, once that is noticed."""
    rows, goals = [], []
    for number in (1, 2, 6):
        spec = Spec(dead=tuple(range(2, 2 + number)))
        run = run_subject("line", spec, warm_s=8.0, seconds=20.0, response_s=0.02)
        found, what = account(run.seen, run.law), f"line, {number} of 8 dead"
        shares = [f"{found.efficiency:.4f}", f"{found.whole:.4f}", f"{found.silent_share:.2%}"]
        rows.append([what, *shares, str(found.too_soon)])
        goals += _goals(what, found, 0.98)
        goals.append(Goal(f"line time of the dead: {what}", found.silent_share, 0.05, is_most=True))
    head = ["master", "of the answering", "of the line", "line time of the offline", "too soon"]
    note = "The line is configured with a response time of 20 ms at most."
    return BenchRow(table("Offline starters, 19200", head, rows, note=note), goals)


def _goals(what: str, found: Account, limit: float) -> list[Goal]:
    return [
        Goal(f"efficiency: {what}", found.efficiency, limit),
        Goal(f"too soon: {what}", found.too_soon, 0, is_most=True),
    ]


def _ways_s(run: Run) -> tuple[list[float], list[float]]:
    """Return how long requests took from write() to the judge, and replies from the judge to poll()."""
    starts_s = [each.start_s for each in run.seen]
    way_in, way_out = [], []
    for written_s, read_s in run.span.marks:
        place = bisect(starts_s, written_s)
        if place < len(starts_s) and run.seen[place].end_s <= read_s:
            way_in.append(run.seen[place].start_s - written_s)
            way_out.append(read_s - run.seen[place].end_s)
    return way_in, way_out


def _us(seconds: float) -> str:
    return f"{seconds * 1e6:.0f}"
