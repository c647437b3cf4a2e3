"""What a measured machine holds, and whether a site needs more: the texts of `doctor` and `check`."""

from __future__ import annotations

from collections.abc import Iterable

from gateway.app.capacity import LineCapacity
from gateway.cli.box.speed import BoxSpeed
from gateway.config.convert import timing_of
from gateway.line.capacity.processor import (
    FULL_STARTERS,
    FULL_TIMING,
    HELD_SHARE,
    LineDemand,
    demand_of,
    full_lines_held,
    processor_share,
)


def demands_of(prospects: Iterable[LineCapacity]) -> tuple[LineDemand, ...]:
    """Return what the lines of a site ask of the processor."""
    return tuple(
        demand_of(line.forecast, timing_of(line.table), starters=len(line.starters)) for line in prospects
    )


def capacity(speed: BoxSpeed, demands: Iterable[LineDemand]) -> str:
    """Return what the machine holds, and how much of it the site takes at most."""
    held = full_lines_held(slowness=speed.slowness)
    lines = f"{held or 'no'} {'line' if held == 1 else 'lines'} of {FULL_STARTERS} starters"
    share = processor_share(demands, slowness=speed.slowness)
    full = f"{lines} at {FULL_TIMING.baud}, asked without a pause"
    return f"holds {full}; this site takes {share:.0%} of a processor"


def excess(speed: BoxSpeed, demands: Iterable[LineDemand]) -> str:
    """Return by how much the site is more than the machine holds, with a remedy; else an empty text."""
    share = processor_share(demands, slowness=speed.slowness)
    if share <= HELD_SHARE:
        return ""
    what = f"this site takes {share:.0%} of a processor of this machine, which holds up to {HELD_SHARE:.0%}"
    return f"{what} (a faster machine, a longer every_s, or lines on another gateway)"
