"""What a configuration asks of its lines, and which watchdogs in its starters would trip on them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import isinf
from typing import Any

from gateway.app.advice import hint_of
from gateway.config.convert import setups_of, timing_of
from gateway.config.mistakes import Mistake
from gateway.config.schema import Config, LineTable, StarterTable
from gateway.families.diagnosis.identify import identify_requests
from gateway.line.capacity.deadline_check import missed_in
from gateway.line.capacity.forecast import Forecast, forecast, longest_gap_s
from gateway.line.scheduler.requests import Poll
from gateway.starters.setup import StarterSetup
from gateway.starters.telemetry.polling import polls_of


@dataclass(frozen=True, slots=True)
class StarterCapacity:
    """One starter's share of a line."""

    table: StarterTable
    ages_s: dict[str, float]  # by group of values: an estimate of the oldest they get without commands
    gap_s: float  # an estimate of the longest time between two requests to it without commands
    margin_s: (
        float | None
    )  # promised for its watchdog with commands under way; None when it is off or not known


@dataclass(frozen=True, slots=True)
class LineCapacity:
    """One line."""

    table: LineTable
    forecast: Forecast  # while starters are being identified, too
    starters: tuple[StarterCapacity, ...]  # the enabled ones


def prospects_of(config: Config) -> tuple[LineCapacity, ...]:
    """Return what every line of a configuration will be like."""
    return tuple(_line(line) for line in config.lines)


def computed_of(line: LineCapacity) -> dict[str, Any]:
    """Return a line's figures as they should be at the worst, for `B/gateway/line/{line}`."""
    margins_s = [each.margin_s for each in line.starters if each.margin_s is not None]
    ages_s: dict[str, float] = {}
    for starter in line.starters:
        for group, age_s in starter.ages_s.items():
            ages_s[group] = round(max(age_s, ages_s.get(group, 0.0)), 4)
    return {
        "load": round(line.forecast.load, 4),
        "sweep_s": round(line.forecast.sweep_s, 4),
        "stop_latency_s": round(line.forecast.stop_latency_s, 4),
        "age_s": ages_s,
        "watchdog_margin_s": round(min(margins_s), 4) if margins_s else None,
        "is_paced": all(each.poll.every_s for each in line.forecast.polls),  # else it is to be always full
    }


def check_watchdogs(config: Config) -> list[Mistake]:
    """Return the watchdogs that the lines of a configuration cannot keep, as mistakes; see `config.load`."""
    return missed_deadlines(prospects_of(config))


def missed_deadlines(prospects: Iterable[LineCapacity]) -> list[Mistake]:
    """Return the watchdogs that would trip although everything works; of a site's lines in their order."""
    mistakes = []
    for index, line in enumerate(prospects):
        units = {each.unit for each in missed_in(line.forecast)}
        missed = [each for each in line.starters if each.table.address in units]
        hint = hint_of(line.table) if missed else ""
        for starter in missed:
            key = ("line", index, "starter", line.table.starters.index(starter.table), "watchdog_s")
            mistakes.append(Mistake(key, _miss(line, starter), hint))
    return mistakes


def _miss(line: LineCapacity, starter: StarterCapacity) -> str:
    limit_s, margin_s = starter.table.watchdog_s, starter.margin_s
    if limit_s is None or margin_s is None or isinf(margin_s):
        share = f"{line.forecast.watchdog_load:.0%} of the line's time"
        return f"{starter.table.name}: {limit_s:g} s cannot be kept: the watchdogs on this line need {share}"
    missed = f"{limit_s:g} s is missed by {-margin_s:.2f} s"
    return f"{starter.table.name}: {missed}: a gap may be {limit_s - margin_s:.2f} s"


def _line(line: LineTable) -> LineCapacity:
    timing = timing_of(line)
    setups = setups_of(line)
    polls = [poll for setup in setups for poll in polls_of(setup)]
    others = [poll for setup in setups if setup.is_enabled for poll in _identification(setup)]
    whole = forecast(polls, timing, allowance_s=line.adapter_allowance_s, jobs=others)
    return LineCapacity(
        table=line,
        forecast=whole,
        starters=tuple(
            _starter(table, setup, whole)
            for table, setup in zip(line.starters, setups, strict=True)
            if setup.is_enabled
        ),
    )


def _starter(table: StarterTable, setup: StarterSetup, whole: Forecast) -> StarterCapacity:
    ages_s: dict[str, float] = {}
    for each in whole.polls:
        if each.poll.unit == setup.address:
            ages_s[each.poll.group] = max(ages_s.get(each.poll.group, 0.0), each.age_s)
    gap_s = longest_gap_s(whole, setup.address)
    promised_s = whole.watchdog_gaps_s.get(setup.address, gap_s)
    return StarterCapacity(table, ages_s, gap_s, table.watchdog_s - promised_s if table.watchdog_s else None)


def _identification(setup: StarterSetup) -> list[Poll]:
    """Return an identification's requests in the shape of polls: they keep a stop waiting as those do."""
    return [
        Poll(question.tag, setup.address, question.request, 0.0, setup.response_time_of(question.request))
        for question in identify_requests(setup.profile)
    ]
