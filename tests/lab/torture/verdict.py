"""What must hold after every scenario."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

from gateway.line.capacity.outage import WIDE_FACTOR
from tests.lab.torture.books import unfinished
from tests.lab.torture.machine import MACHINE
from tests.lab.torture.truth import never_had
from tests.lab.torture.waiting import until
from tests.lab.torture.world import STOP_WITHIN_S, World

LATE_S = 0.004  # held up for longer, and silences and replies on our line are not what they seem
AROUND_S = 0.3
EXCUSED_SHARE = 0.01  # of all requests: more than that is no chance
FINISHED_WITHIN_S = 20.0  # of the end of a scenario
GROWN_KIB = 20_000
REPORTED_FROM_S = 0.5  # less than that is not worth a word


async def judge(w: World, *, begun_s: float, may_trip: bool = False) -> None:
    """Check what starters, recorder and gateway have lived through since `begun_s`."""
    report = await w.report(values=True)
    for name, each in report["starters"].items():
        trips = [code for at_s, code in each["trips"] if not _is_machines_trip(w, at_s)]
        if not may_trip and len(trips) < len(each["trips"]):
            w.measurements[f"trips of {name}"] = f"{len(each['trips']) - len(trips)} for want of a processor"
        w.check(may_trip or not trips, f"{name}: watchdog tripped ({trips})")
        frames, commanded = each["start_frames"], w.commanded[name]
        w.check(frames <= commanded, f"{name}: {frames} start frames for {commanded} commands")
    _judge_line(w, report)
    _judge_values(w, report["values"])
    finals = w.recorder.finals_of_ids()
    w.check(max(finals.values(), default=1) == 1, f"several final results: {finals.most_common(3)}")
    books = w.recorder.books
    w.check(not books.wrong, f"boot and seq mislead: {books.wrong[:3]}")
    await _judge_results(w)
    w.check(not w.recorder.bad, f"unreadable messages: {w.recorder.bad[:3]}")
    w.check("Traceback" not in w.gateway.log, "an unhandled exception is in the log")
    bound_s = STOP_WITHIN_S + _stop_latency_s(w)
    w.check(max(w.stops_s, default=0.0) <= bound_s, f"a stop took {max(w.stops_s, default=0)} s")
    _judge_samples(w)
    held_s = MACHINE.held_s(begun_s)
    if held_s > REPORTED_FROM_S:
        w.measurements["held up by the machine s"] = round(held_s, 1)


async def _judge_results(w: World) -> None:
    """Check that every accepted command has a final result."""
    results = w.recorder.results
    with suppress(TimeoutError):
        await until(lambda: not unfinished(results[:]), "all commands are over", within_s=FINISHED_WITHIN_S)
    left = unfinished(results[:])
    w.check(not left, f"{len(left)} commands have no end: {left[:3]}")


def _is_machines_trip(w: World, at_s: float) -> bool:
    """Return whether a starter would not have tripped, had the machine let us run."""
    silent_s = w.watchdog_s - MACHINE.held_s(at_s - w.watchdog_s, at_s)
    return silent_s <= w.watchdog_s / WIDE_FACTOR


def _judge_line(w: World, report: dict[str, Any]) -> None:
    """Check that the gateway observed all silences; what the machine muddled is counted, and must be rare."""
    faults = [
        text
        for at_s, text in report["violations"]
        if MACHINE.held_s(at_s - AROUND_S, at_s + AROUND_S) <= LATE_S
    ]
    excused = len(report["violations"]) - len(faults)
    requests = sum(each["requests"] for each in report["starters"].values())
    w.check(not faults, f"line violations: {faults[:3]}")
    w.check(excused <= 1 + EXCUSED_SHARE * requests, f"{excused} line violations in {requests} requests")
    if excused:
        w.measurements["line muddled by the machine"] = excused


def _judge_values(w: World, values: dict[str, dict[str, list[Any]]]) -> None:
    false = never_had(w.recorder.good, values)
    w.measurements["good values"] = len(w.recorder.good)
    w.check(not false, f"shown as good, never had: {false[:3]}")


def _judge_samples(w: World) -> None:
    if len(w.samples) < 2:
        return
    (first, first_files), (last, last_files) = w.samples[0], w.samples[-1]
    w.check(last_files <= first_files + 1, f"file descriptors {first_files} -> {last_files}")
    w.check(last.threads <= first.threads + 1, f"threads {first.threads} -> {last.threads}")
    grown_kib = last.rss_kib - first.rss_kib
    w.check(grown_kib < GROWN_KIB, f"memory {first.rss_kib} -> {last.rss_kib} KiB")


def _stop_latency_s(w: World) -> float:
    statistics = w.recorder.latest.get("gateway/line/hall", {})
    return float(statistics.get("stop_latency_s", {}).get("computed", 1.0))
