"""What a configuration asks of its lines, which watchdogs would trip on them, and what would help."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import isinf
from typing import Any, NamedTuple, get_args

from gateway.config import WHERE_RIGHT, Baud, Config, LineTable, Mistake, StarterTable, setups_of, timing_of
from gateway.families import diagnosis
from gateway.line import Poll, capacity
from gateway.modbus import LineTiming
from gateway.starters import StarterSetup, polls_of


@dataclass(frozen=True, slots=True)
class StarterCapacity:
    """One starter's share of a line."""

    table: StarterTable
    gap_s: float  # an estimate of the longest time between two requests to it without commands
    first_poll_s: float  # at the latest until it gets its first request after the line's port is open
    margin_s: float | None  # of its watchdog, with commands under way; None: it is off, or not known


@dataclass(frozen=True, slots=True)
class LineCapacity:
    """One line."""

    table: LineTable
    forecast: capacity.Forecast  # while starters are being identified, too
    starters: tuple[StarterCapacity, ...]  # the enabled ones


class ExtraCost(NamedTuple):
    """What the points that a configuration asks for cost a line."""

    points: Mapping[str, int]  # how many, by starter
    already: Mapping[str, Sequence[str]]  # rows asked for that are points of the family, by starter
    reads: int  # requests besides those that are made without them
    load: float  # share of the line's time


def extra_cost_of(line: LineTable) -> ExtraCost:
    """Return what the extra points of a line cost it; of disabled starters nothing."""
    plain = line.model_copy(update={"starters": tuple(each.plain() for each in line.starters)})
    counts, already = {}, {}
    for each in line.starters:
        points = each.profile().points.values()
        codes = {point.code for point in points if point.every_s is not None}
        counts[each.name] = len(codes)
        already[each.name] = [asked.code for asked in each.asked if asked.code not in codes]
    polls, fewer = _polls_of(line), _polls_of(plain)
    allowance_s, timing = line.adapter_allowance_s, timing_of(line)
    load, least = (capacity.forecast(each, timing, allowance_s=allowance_s).load for each in (polls, fewer))
    return ExtraCost(counts, already, len(polls) - len(fewer), load - least)


def prospects_of(config: Config) -> tuple[LineCapacity, ...]:
    """Return what every line of a configuration will be like."""
    return tuple(_line(line) for line in config.lines)


def computed_of(line: LineCapacity) -> dict[str, Any]:
    """Return a line's computed worst-case statistics, for `B/gateway/line/{line}`."""
    margins_s = [each.margin_s for each in line.starters if each.margin_s is not None]
    return {
        "load": round(line.forecast.load, 4),
        "sweep_s": round(line.forecast.sweep_s, 4),
        "stop_latency_s": round(line.forecast.stop_latency_s, 4),
        "watchdog_margin_s": round(min(margins_s), 4) if margins_s else None,
        "is_paced": all(each.table.every_s for each in line.starters),  # else it is to be always full
    }


def check_watchdogs(config: Config, prospects: list[LineCapacity] | None = None) -> Iterator[Mistake]:
    """Yield the watchdogs that would trip although everything works; see `config.load`.

    `prospects` is given what every line will be like that has no other mistakes.
    """
    for index, table in enumerate(config.lines):
        with WHERE_RIGHT:
            line = _line(table)
            if prospects is not None:
                prospects.append(line)
            units = {each.unit for each in line.forecast.missed}
            missed = [each for each in line.starters if each.table.address in units]
            hint = hint_of(table) if missed else ""
            for starter in missed:
                key = ("line", index, "starter", table.starters.index(starter.table), "watchdog_s")
                yield Mistake(key, _miss(line, starter), hint)


def hint_of(line: LineTable) -> str:
    """Return, in words, each single change after which the line serves every watchdog in time.

    Fewer points are none: a watchdog's request goes before all polls, and is a starter's shortest.
    """
    polls, timing, found = _polls_of(line), timing_of(line), []

    def holds(polls: Sequence[Poll], timing: LineTiming = timing) -> bool:
        return not capacity.forecast(polls, timing, allowance_s=line.adapter_allowance_s).missed

    allowed = [set(each.profile().bauds or get_args(Baud)) for each in line.starters if each.enabled]
    faster = sorted(baud for baud in set(get_args(Baud)).intersection(*allowed) if baud > line.baud)
    enough = next((baud for baud in faster if holds(polls, LineTiming(baud, timing.framing))), None)
    if enough is not None:
        found.append(f"baud = {enough}")
    units = list(dict.fromkeys(poll.unit for poll in polls))
    stay = _most(len(units), lambda count: holds([p for p in polls if p.unit in units[:count]]))
    if stay:
        found.append(f"{len(units) - stay} of its {len(units)} starters on another line")
    shortest = capacity.least_whole(lambda limit_s: holds(_with_watchdogs(polls, limit_s)))
    if shortest is not None:
        found.append(f"no watchdog below {shortest:g} s")
    return ", or ".join(found)


def _miss(line: LineCapacity, starter: StarterCapacity) -> str:
    limit_s, margin_s = starter.table.watchdog_s, starter.margin_s
    if limit_s is None or margin_s is None or isinf(margin_s):
        share = f"{line.forecast.watchdog_load:.0%} of the line's time"
        return f"{starter.table.name}: {limit_s:g} s is too short: the watchdogs on this line need {share}"
    missed = f"{limit_s:g} s is missed by {-margin_s:.2f} s"
    return f"{starter.table.name}: {missed}: a gap may be {limit_s - margin_s:.2f} s"


def _line(line: LineTable) -> LineCapacity:
    timing = timing_of(line)
    setups = setups_of(line)
    polls = _polls_of(line)
    others = [poll for setup in setups if setup.is_enabled for poll in _identification(setup)]
    whole = capacity.forecast(polls, timing, allowance_s=line.adapter_allowance_s, jobs=others)
    limits_s = {each.address: each.watchdog_s for each in line.starters if each.watchdog_s}
    firsts_s = capacity.first_requests_s(
        polls, timing, limits_s=limits_s, allowance_s=line.adapter_allowance_s
    )
    return LineCapacity(
        table=line,
        forecast=whole,
        starters=tuple(_starter(table, whole, firsts_s) for table in line.starters if table.enabled),
    )


def _starter(table: StarterTable, whole: capacity.Forecast, firsts_s: Mapping[int, float]) -> StarterCapacity:
    gap_s = whole.gaps_s[table.address]
    promised_s = whole.watchdog_gaps_s.get(table.address, gap_s)
    margin_s = table.watchdog_s - promised_s if table.watchdog_s else None
    return StarterCapacity(table, gap_s, firsts_s[table.address], margin_s)


def _identification(setup: StarterSetup) -> list[Poll]:
    """Return an identification's requests in the shape of polls: they keep a stop waiting as those do."""
    return [
        Poll(question.tag, setup.address, question.request, 0.0, setup.response_time_of(question.request))
        for question in diagnosis.identify_requests(setup.profile)
    ]


def _polls_of(line: LineTable) -> list[Poll]:
    return [poll for setup in setups_of(line) for poll in polls_of(setup)]


def _with_watchdogs(polls: Sequence[Poll], least_s: float) -> list[Poll]:
    return [
        replace(poll, deadline_s=max(poll.deadline_s, least_s)) if poll.deadline_s else poll for poll in polls
    ]


def _most(count: int, holds: Callable[[int], bool]) -> int:
    """Return the largest number below `count` for which it holds; 0 when it holds for none."""
    low, high = 0, count
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low
