"""What `check` says of failures: how long each starter hears nothing then, and which watchdogs would act."""

from __future__ import annotations

from collections.abc import Iterator

from gateway.config.prospects import LineProspect, StarterProspect
from gateway.config.setups import timing_of
from gateway.line.gaps import (
    FEEDS,
    LOOK_S,
    WIDE_FACTOR,
    Gaps,
    Restart,
    first_request_s,
    gaps_of,
    start_order,
)

SHORTEST_LIMIT_S = 2.0  # of the service watchdog: a slow line needs most of a second for one transaction


def gaps_of_starter(line: LineProspect, starter: StarterProspect, restart: Restart | None = None) -> Gaps:
    """Return the longest gaps of a starter, with the shipped unit's times unless others are given."""
    limits_s = {each.address: each.watchdog_s for each in line.table.starters if each.watchdog_s}
    polls = start_order((each.poll for each in line.forecast.polls), limits_s)
    allowance_s = line.table.adapter_allowance_s
    first_s = first_request_s(polls, timing_of(line.table), starter.table.address, allowance_s=allowance_s)
    return gaps_of(starter.gap_s, first_s, restart)


def print_gaps(line: LineProspect) -> None:
    """Print the longest gaps of every starter beside its watchdog."""
    if not line.starters:
        return
    width = max(7, *(len(starter.table.name) for starter in line.starters))
    print(f"  {'':{width}}  longest time without a request when the gateway   (watchdog)")
    print(f"  {'starter':{width}}     works   crashes     hangs")
    for starter in line.starters:
        gaps = gaps_of_starter(line, starter)
        times = "  ".join(f"{gap_s:6.2f} s" for gap_s in (gaps.regular_s, gaps.crash_s, gaps.hang_s))
        print(f"  {starter.table.name:{width}}  {times}   {_judged(starter, gaps)}")


def tight_watchdogs(prospects: tuple[LineProspect, ...]) -> Iterator[str]:
    """Tell the starters whose watchdog would act on a failure of the gateway, and what would help."""
    for line in prospects:
        for starter in line.starters:
            limit_s = starter.table.watchdog_s
            if not limit_s or limit_s < WIDE_FACTOR * starter.gap_s:
                continue  # off, or too tight even while everything works, which is told elsewhere
            gaps = gaps_of_starter(line, starter)
            for_crash_s, for_hang_s = gaps.wanted_s
            what = f"starter {starter.table.name}: its watchdog of {limit_s:g} s acts when the gateway"
            if limit_s < for_crash_s:
                gap = f"{gaps.crash_s:.1f} s without a request"
                yield f"{what} crashes: {gap} (make it {for_crash_s:.1f} s, or every_s shorter)"
            elif limit_s < for_hang_s:
                gap = f"{gaps.hang_s:.1f} s without a request"
                yield f"{what} hangs: {gap} (make it {for_hang_s:.1f} s{_shorter(limit_s, gaps)})"


def as_json(line: LineProspect, starter: StarterProspect) -> dict[str, float]:
    """Return the gaps after failures for `check --json`."""
    gaps = gaps_of_starter(line, starter)
    return {"crash_gap_s": round(gaps.crash_s, 4), "hang_gap_s": round(gaps.hang_s, 4)}


def _judged(starter: StarterProspect, gaps: Gaps) -> str:
    limit_s = starter.table.watchdog_s
    if limit_s is None:
        return "(not stated)"
    if not limit_s:
        return "(off)"
    for_crash_s, for_hang_s = gaps.wanted_s
    outlasts = "nothing" if limit_s < for_crash_s else "a crash" if limit_s < for_hang_s else "both"
    return f"({limit_s:g} s outlasts {outlasts})"


def _shorter(limit_s: float, gaps: Gaps) -> str:
    """Return which setting of the service would do as well, if any."""
    spare_s = limit_s / WIDE_FACTOR - gaps.crash_s - LOOK_S - Restart().abort_s
    service_s = int(spare_s / (1.0 + 1.0 / FEEDS))
    return f", or WatchdogSec={service_s}s in the service" if service_s >= SHORTEST_LIMIT_S else ""
