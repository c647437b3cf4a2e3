"""What must hold after every scenario."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

from gateway.line.capacity.outage import WIDE_FACTOR
from tests.lab.torture.books import unfinished
from tests.lab.torture.machine import MACHINE, until
from tests.lab.torture.truth import never_had
from tests.lab.torture.world import STOP_WITHIN_S, World

LATE_S = 0.004  # held up for longer, and silences and replies on our line are not what they seem
AROUND_S = 0.3
EXCUSED_SHARE = 0.01  # of all requests: more than that is no chance
FINISHED_WITHIN_S = 20.0  # of the end of a scenario
GROWN_KIB = 20_000
REPORTED_FROM_S = 0.5  # less than that is not worth a word


async def judge(w: World, *, begun_s: float, may_trip: bool = False) -> None:
    """Check what starters, recorder and gateway have lived through since `begun_s`."""
    report, recorder = await w.report(values=True), w.recorder
    for name, each in report["starters"].items():
        _judge_trips(w, name, each["trips"], may_trip=may_trip)
        frames, commanded = each["start_frames"], w.commanded[name]
        w.check(frames <= commanded, f"{name}: {frames} start frames for {commanded} commands")
    _judge_silences(w, report)
    with suppress(TimeoutError):
        await until(lambda: not unfinished(recorder.results[:]), "", within_s=FINISHED_WITHIN_S)
    left, finals = unfinished(recorder.results[:]), recorder.finals_of_ids()
    false = never_had(recorder.good, {name: each["values"] for name, each in report["starters"].items()})
    latency_s = recorder.newest("gateway/line/hall").get("stop_latency_s", {}).get("computed", 1.0)
    slowest_s, held_s = max(w.stops_s, default=0.0), MACHINE.held_s(begun_s)
    w.row.measurements["good values"] = len(recorder.good)
    if held_s > REPORTED_FROM_S:
        w.row.measurements["held up by the machine s"] = round(held_s, 1)
    for is_right, what in (
        (not false, f"shown as good, never had: {false[:3]}"),
        (not left, f"{len(left)} commands have no end: {left[:3]}"),
        (max(finals.values(), default=1) == 1, f"several final results: {finals.most_common(3)}"),
        (not recorder.books.wrong, f"boot and seq mislead: {recorder.books.wrong[:3]}"),
        (not recorder.bad, f"unreadable messages: {recorder.bad[:3]}"),
        ("Traceback" not in w.gateway.log, "an unhandled exception is in the log"),
        (slowest_s <= STOP_WITHIN_S + latency_s, f"a stop took {slowest_s} s"),
    ):
        w.check(is_right, what)
    if len(w.samples) > 1:
        (first, first_files), (last, last_files) = w.samples[0], w.samples[-1]
        w.check(last_files <= first_files + 1, f"file descriptors {first_files} -> {last_files}")
        w.check(last.threads <= first.threads + 1, f"threads {first.threads} -> {last.threads}")
        grown_kib = last.rss_kib - first.rss_kib
        w.check(grown_kib < GROWN_KIB, f"memory {first.rss_kib} -> {last.rss_kib} KiB")


def _judge_trips(w: World, name: str, trips: list[tuple[float, str]], *, may_trip: bool) -> None:
    """Check that no watchdog has acted, but for want of a processor."""
    faults = [
        code
        for at_s, code in trips
        if w.watchdog_s - MACHINE.held_s(at_s - w.watchdog_s, at_s) > w.watchdog_s / WIDE_FACTOR
    ]
    if not may_trip and len(faults) < len(trips):
        w.row.measurements[f"trips of {name}"] = f"{len(trips) - len(faults)} for want of a processor"
    w.check(may_trip or not faults, f"{name}: watchdog tripped ({faults})")


def _judge_silences(w: World, report: dict[str, Any]) -> None:
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
        w.row.measurements["line muddled by the machine"] = excused
