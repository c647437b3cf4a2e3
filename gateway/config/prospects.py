"""What a configuration asks of its lines, and which watchdogs in its starters would trip on them."""

from __future__ import annotations

from dataclasses import dataclass

from gateway.config.locate import Key
from gateway.config.mistake import Mistake
from gateway.config.schema import Config, LineTable, StarterTable
from gateway.config.setups import setups_of, timing_of
from gateway.families.identify import identify_requests
from gateway.line.budget import worst_stop_latency_s
from gateway.line.forecast import Forecast, forecast, longest_gap_s
from gateway.line.job import Poll
from gateway.starters.polling import polls_of
from gateway.starters.setup import StarterSetup


@dataclass(frozen=True, slots=True)
class StarterProspect:
    """One starter's share of a line."""

    table: StarterTable
    ages_s: dict[str, float]  # by group of values: the oldest they get before newer ones come
    gap_s: float  # the longest time between two requests to it
    margin_s: float | None  # what its watchdog has beyond that; None when it is off or not known


@dataclass(frozen=True, slots=True)
class LineProspect:
    """One line."""

    table: LineTable
    forecast: Forecast
    stop_latency_s: float  # at the worst, while starters are being identified too
    starters: tuple[StarterProspect, ...]  # the enabled ones


def prospects_of(config: Config) -> tuple[LineProspect, ...]:
    """Return what every line of a configuration will be like."""
    return tuple(_line(line) for line in config.lines)


def missed_deadlines(config: Config) -> list[Mistake]:
    """Return the watchdogs that would trip although everything works."""
    return [
        _missed(("line", index, "starter", line.table.starters.index(starter.table)), starter)
        for index, line in enumerate(prospects_of(config))
        for starter in line.starters
        if starter.margin_s is not None and starter.margin_s < 0
    ]


def _missed(key: Key, starter: StarterProspect) -> Mistake:
    what = f"would trip: up to {starter.gap_s:.2f} s pass between two requests"
    mend = "a longer watchdog, a shorter every_s, or fewer starters on the line"
    return Mistake((*key, "watchdog_s"), what, mend)


def _line(line: LineTable) -> LineProspect:
    timing = timing_of(line)
    setups = setups_of(line)
    polls = [poll for setup in setups for poll in polls_of(setup)]
    whole = forecast(polls, timing, allowance_s=line.adapter_allowance_s)
    asked = [*polls, *(poll for setup in setups if setup.is_enabled for poll in _identification(setup))]
    return LineProspect(
        table=line,
        forecast=whole,
        stop_latency_s=worst_stop_latency_s(asked, timing, allowance_s=line.adapter_allowance_s),
        starters=tuple(
            _starter(table, setup, whole)
            for table, setup in zip(line.starters, setups, strict=True)
            if setup.is_enabled
        ),
    )


def _starter(table: StarterTable, setup: StarterSetup, whole: Forecast) -> StarterProspect:
    ages_s: dict[str, float] = {}
    for each in whole.polls:
        if each.poll.unit == setup.address:
            group = each.poll.key.removeprefix(f"{setup.name}/").partition(":")[0]
            ages_s[group] = max(ages_s.get(group, 0.0), each.age_s)
    gap_s = longest_gap_s(whole, setup.address)
    return StarterProspect(table, ages_s, gap_s, table.watchdog_s - gap_s if table.watchdog_s else None)


def _identification(setup: StarterSetup) -> list[Poll]:
    """Return an identification's requests in the shape of polls: they keep a stop waiting as those do."""
    return [
        Poll(question.tag, setup.address, question.request, 0.0, setup.response_time_of(question.request))
        for question in identify_requests(setup.profile)
    ]
