"""Rows of the bench about the whole: processor time and memory, stops, the sweep, the start."""

from __future__ import annotations

from collections.abc import Iterator

from tests.lab.bench.account import Stop, quantile, stops, sweeps_s
from tests.lab.bench.judge import Spec
from tests.lab.bench.plant import run_gateway
from tests.lab.bench.report import Goal, table
from tests.lab.bench.rows import MASTERS, BenchRow, measured
from tests.lab.bench.runs import Run, run_subject

FLATNESS = 1.15 / 0.85  # all within 15 % of one figure
MANY = 247


def cpu() -> BenchRow:
    """Processor time and memory, whatever the number of starters and lines."""
    rows, goals = [], []
    for master in MASTERS:
        costs_ms = []
        for spec in _sizes("ssw07" if master == "gateway" else ""):
            run = _sized(master, spec)
            what = f"{master}, {spec.lines} x {spec.units}"
            costs_ms.append(run.cpu_s * 1e3)
            rows.append(_cost(what, run))
            if master == "gateway":
                goals.append(Goal(f"CPU: {what}", costs_ms[-1], 0.8, is_most=True, unit=" ms"))
                goals.append(Goal(f"memory: {what}", _mib(run), 80, is_most=True, unit=" MiB"))
        few_ms, many_ms = costs_ms[:4], costs_ms[4:]
        spread = max(few_ms) / min(few_ms)
        goals.append(Goal(f"CPU, 1 to 247 starters, most / least: {master}", spread, FLATNESS, is_most=True))
        growth = max(many_ms) / costs_ms[1]
        goals.append(Goal(f"CPU, more lines / one: {master}", growth, 1.15, is_most=True))
    note = (
        "A request's. Here the gateway reads SSW-07s whose motors run: 1 to 3 registers a request, so some 60"
        "\nrequests a second, each decoded and published. More lines cost less each: caches stay warm."
        "\nThe judge sleeps here: a neighbour in a busy loop slows down what shares its core."
    )
    head = ["master, lines x starters", "requests", "CPU ms", "MiB"]
    return BenchRow(table("Cost of a transaction, 19200", head, rows, note=note), goals)


def start() -> BenchRow:
    """From the gateway's start to its first request on the wire."""
    rows, goals = [], []
    for spec in _sizes("ssw07"):
        if spec.units not in (8, MANY) or spec.lines > 1:
            continue
        first_s = _sized("gateway", spec).first_s
        rows.append([f"{spec.units} starters", f"{first_s:.2f}"])
        goals.append(Goal(f"cold start: {spec.units} starters", first_s, 1.0, is_most=True, unit=" s"))
    return BenchRow(table("Cold start to first poll", ["gateway", "s"], rows), goals)


def stop() -> BenchRow:
    """From a stop to its first byte, while the line is saturated."""
    rows, goals = [], []
    for master, units in (("line", 32), ("line", MANY), ("gateway", 32)):
        if master == "gateway":
            run = run_gateway(Spec(units=units, family="ssw07"), warm_s=6.0, seconds=12.0, stops=30)
        else:
            run = run_subject(master, Spec(units=units), seconds=10.0, stops=50)
        found = stops(run.seen, run.span.stops, run.law)
        what = f"{master}, {units} starters"
        rows.append([what, f"{len(found)} of {len(run.span.stops)}", *_stop_cells(found)])
        late_ms = max((each.excess_s for each in found), default=float("nan")) * 1e3
        goals.append(Goal(f"stop, beyond what it must wait: {what}", late_ms, 5, is_most=True, unit=" ms"))
        goals.append(Goal(f"stops seen: {what}", len(found), len(run.span.stops)))
    head = ["master", "stops", "crossed", "p50 ms", "most", "transaction", "p50 / it", "beyond p50", "most"]
    note = (
        "Milliseconds from submission (gateway: the message's arrival at another subscriber) to the"
        "\nfirst byte on the wire. Transaction: the one it waits for, its silence too, p50. Beyond: after."
        "\nCrossed: that one began in the millisecond that a stop needs to the line."
    )
    return BenchRow(table("Stop, 19200, saturated", head, rows, note=note), goals)


def sweep() -> BenchRow:
    """All 247 starters, none left out, in a round as long as computed."""
    run = run_subject("line", Spec(units=MANY), seconds=20.0)
    rounds_s = sweeps_s(run.seen)
    computed_s = MANY * run.law.ideal_s(run.seen[0])
    asked = len({each.unit for each in run.seen})
    longest_s = max(rounds_s, default=float("nan"))
    row = ["line", f"{computed_s:.3f}", f"{quantile(rounds_s, 0.5):.3f}", f"{longest_s:.3f}", str(asked)]
    goals = [
        Goal("sweep, longest / computed", longest_s / computed_s, 1.02, is_most=True),
        Goal("sweep, starters asked", asked, MANY),
    ]
    head = ["", "computed s", "p50 s", "longest s", "starters asked"]
    return BenchRow(table("Sweep of 247 starters, 19200", head, [row]), goals)


def _sizes(family: str) -> Iterator[Spec]:
    for units in (1, 8, 32, MANY):
        yield Spec(units=units, family=family, is_calm=True)
    for lines in (4, 8):
        yield Spec(lines=lines, family=family, is_calm=True)


def _sized(master: str, spec: Spec) -> Run:
    if master != "gateway":
        return measured(master, spec)
    warm_s = 6.0 + 0.35 * spec.units  # all are identified first, and their settings looked at
    return measured(master, spec, warm_s, 6.0)


def _cost(what: str, run: Run) -> list[str]:
    return [what, str(len(run.seen)), f"{run.cpu_s * 1e3:.2f}", f"{_mib(run):.0f}"]


def _mib(run: Run) -> float:
    return run.span.rss_kib / 1024


def _stop_cells(found: list[Stop]) -> list[str]:
    waits_s = [each.latency_s for each in found]
    excess_s = [each.excess_s for each in found]
    under_way_s = quantile((each.under_way_s for each in found), 0.5)
    return [
        str(sum(each.is_crossed for each in found)),
        f"{quantile(waits_s, 0.5) * 1e3:.1f}",
        f"{quantile(waits_s, 1.0) * 1e3:.1f}",
        f"{under_way_s * 1e3:.1f}",
        f"{quantile(waits_s, 0.5) / under_way_s:.2f}",
        f"{quantile(excess_s, 0.5) * 1e3:.2f}",
        f"{quantile(excess_s, 1.0) * 1e3:.2f}",
    ]
