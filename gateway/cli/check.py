"""`starter-gateway check`: validates a configuration and prints what each line will do.

For each line: load, sweep time, value ages and stop latency. For each starter: the longest time without a
request while the gateway works, after it crashes and while it hangs, and whether its watchdog outlasts that.
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

from gateway.app.advice import fast_gains, fast_lines, relief_of
from gateway.app.capacity import LineCapacity, StarterCapacity
from gateway.app.site import Site
from gateway.cli.command import Subparsers
from gateway.config.convert import timing_of
from gateway.config.schema import Config, LineTable
from gateway.errors import ConfigError
from gateway.families.profile.load import load_profile
from gateway.line.capacity.outage import (
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


def gaps_of_starter(line: LineCapacity, starter: StarterCapacity, restart: Restart | None = None) -> Gaps:
    """Return the longest gaps of a starter, with the shipped unit's times unless others are given."""
    limits_s = {each.address: each.watchdog_s for each in line.table.starters if each.watchdog_s}
    polls = start_order((each.poll for each in line.forecast.polls), limits_s)
    allowance_s = line.table.adapter_allowance_s
    first_s = first_request_s(polls, timing_of(line.table), starter.table.address, allowance_s=allowance_s)
    return gaps_of(starter.gap_s, first_s, restart)


def print_gaps(line: LineCapacity) -> None:
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


def tight_watchdogs(prospects: tuple[LineCapacity, ...]) -> Iterator[str]:
    """Yield a warning, with a remedy, for each starter whose watchdog a failure of the gateway would trip."""
    for line in prospects:
        for starter in line.starters:
            limit_s = starter.table.watchdog_s
            if not limit_s or limit_s < WIDE_FACTOR * starter.gap_s:
                continue  # off, or too tight even while everything works, which another warning reports
            gaps = gaps_of_starter(line, starter)
            for_crash_s, for_hang_s = gaps.wanted_s
            what = f"starter {starter.table.name}: its watchdog of {limit_s:g} s acts when the gateway"
            if limit_s < for_crash_s:
                gap = f"{gaps.crash_s:.1f} s without a request"
                yield f"{what} crashes: {gap} (make it {for_crash_s:.1f} s, or every_s shorter)"
            elif limit_s < for_hang_s:
                gap = f"{gaps.hang_s:.1f} s without a request"
                yield f"{what} hangs: {gap} (make it {for_hang_s:.1f} s{_shorter(limit_s, gaps)})"


def as_json(line: LineCapacity, starter: StarterCapacity) -> dict[str, float]:
    """Return the gaps after failures for `check --json`."""
    gaps = gaps_of_starter(line, starter)
    return {"crash_gap_s": round(gaps.crash_s, 4), "hang_gap_s": round(gaps.hang_s, 4)}


def _judged(starter: StarterCapacity, gaps: Gaps) -> str:
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


_SAFE_FACTOR = 1.5  # a watchdog below this many longest gaps leaves little room for commands and retries
_GROUPS = ("status", "values", "slow")


def add_parser(subparsers: Subparsers) -> None:
    """Add the command's parser."""
    parser = subparsers.add_parser(
        "check", description="Validate a configuration and print the budget of its lines; nothing is opened."
    )
    parser.add_argument("config", metavar="CONFIG", help="the configuration file")
    parser.add_argument("--json", action="store_true", help="print the same as JSON")


def run(args: argparse.Namespace) -> int:
    """Print the budget and the warnings; the caller prints the problems of a wrong configuration."""
    try:
        site = Site.read(Path(args.config), os.environ)
    except ConfigError as error:
        if args.json:
            _print_json(args.config, is_valid=False, problems=_problems(error))
        raise
    config, prospects = site.config, site.prospects
    overloads = list(_overloads(prospects))
    warnings = [
        *_line_warnings(prospects),
        *tight_watchdogs(prospects),
        *_site_warnings(config, Path(args.config).parent),
    ]
    if args.json:
        lines = [_as_json(line) for line in prospects]
        _print_json(args.config, is_valid=True, lines=lines, warnings=[*overloads, *warnings])
        return 0
    for overload in overloads:
        print(f"warning: {overload}")
    print(f"{args.config}: valid, {_site(config)}")
    for line in prospects:
        _print_line(line)
        print_gaps(line)
    for warning in warnings:
        print(f"warning: {warning}")
    return 0


def _print_json(path: str, **content: Any) -> None:
    print(json.dumps({"config": path, **content}, indent=2))


def _site(config: Config) -> str:
    starters = _count(sum(len(line.starters) for line in config.lines), "starter")
    clients = len({operator.client for operator in config.operators})
    rights = _count(clients, "operator") if clients else "read-only"
    return f"{starters} on {_count(len(config.lines), 'line')}, {rights}"


def _count(number: int, what: str) -> str:
    return f"{number} {what}" if number == 1 else f"{number} {what}s"


def _print_line(line: LineCapacity) -> None:
    table, whole = line.table, line.forecast
    print(f"\nline {table.name}: {table.port}, {table.baud} {table.framing}")
    stop = f"a stop waits at most {whole.stop_latency_s:.3f} s"
    print(f"  load {whole.load:.0%}, sweep {whole.sweep_s:.3f} s, {stop}")
    if not line.starters:
        return
    width = max(7, *(len(starter.table.name) for starter in line.starters))
    print(f"  {'starter':{width}}  addr  family    about  status   values     slow   watchdog")
    for starter in line.starters:
        each = starter.table
        ages = "  ".join(_age(starter.ages_s.get(group)) for group in _GROUPS)
        print(f"  {each.name:{width}}  {each.address:4}  {each.family:6}       {ages}   {_watchdog(starter)}")
    for text in fast_lines(table):
        print(text)


def _age(age_s: float | None) -> str:
    return "       -" if age_s is None else f"{age_s:6.2f} s"


def _watchdog(starter: StarterCapacity) -> str:
    if starter.table.watchdog_s is None:
        return f"not stated, must be above {starter.gap_s:.2f} s"
    if starter.margin_s is None:
        return "off"
    return f"{starter.table.watchdog_s:g} s, {starter.margin_s:.2f} s to spare"


def _overloads(prospects: tuple[LineCapacity, ...]) -> Iterator[str]:
    """Say which lines are asked for more than their time: before all else, since nothing else then holds."""
    for line in prospects:
        whole = line.forecast
        if whole.is_overloaded:
            factor = max(each.period_s / each.poll.every_s for each in whole.polls if each.poll.every_s)
            what = f"asked for {whole.load:.0%} of its time, periods become {factor:.1f} times as long"
            yield f"line {line.table.name}: {what} ({relief_of(line.table) or 'use more lines'})"


def _line_warnings(prospects: tuple[LineCapacity, ...]) -> Iterator[str]:
    for line in prospects:
        yield from _segment_warnings(line.table)
        for starter in line.starters:
            limit_s, wanted_s = starter.table.watchdog_s, _SAFE_FACTOR * starter.gap_s
            if limit_s and limit_s < wanted_s:
                what = f"its watchdog of {limit_s:g} s has {starter.margin_s:.2f} s to spare"
                yield f"starter {starter.table.name}: {what} (make it {wanted_s:.1f} s, or every_s shorter)"


def _segment_warnings(table: LineTable) -> Iterator[str]:
    """Say that a line has more devices than a manual allows without a repeater; disabled ones count."""
    limits = {
        profile.title: limit
        for profile in (load_profile(starter.family) for starter in table.starters)
        if (limit := profile.limits.segment_devices) is not None
    }
    title, most = min(limits.items(), key=lambda pair: pair[1], default=("", len(table.starters)))
    if len(table.starters) > most:
        what = f"{len(table.starters)} starters need a repeater, {title} allows {most} without"
        yield f"line {table.name}: {what} (put one in, or use more lines)"


def _site_warnings(config: Config, folder: Path) -> Iterator[str]:
    for name in ("ca_file", "cert_file", "key_file"):
        file = getattr(config.mqtt, name)
        if file is not None and not (folder / file).exists():
            yield f"mqtt.{name}: {folder / file} is not there (put it there before `run`)"
    for line in config.lines:
        if line.port.startswith(("/dev/ttyUSB", "/dev/ttyACM")):
            yield f"line {line.name}: {line.port} may be another adapter tomorrow (use /dev/serial/by-id/...)"
    if config.mqtt.allow_plaintext and not config.mqtt.is_tls:
        yield "mqtt.url: passwords and commands cross the network unencrypted (use mqtts://)"


def _problems(error: ConfigError) -> list[dict[str, Any]]:
    keys = ("hint", "mend")  # the second is its name of before 0.2: keys are only added
    return [
        {"line": p.line, "key": p.key, "what": p.what, **dict.fromkeys(keys, p.hint)} for p in error.problems
    ]


def _as_json(line: LineCapacity) -> dict[str, Any]:
    return {
        "line": line.table.name,
        "load": round(line.forecast.load, 4),
        "is_overloaded": line.forecast.is_overloaded,
        "watchdog_load": round(line.forecast.watchdog_load, 4),
        "sweep_s": round(line.forecast.sweep_s, 4),
        "stop_latency_s": round(line.forecast.stop_latency_s, 4),
        "fast_words": [asdict(gain) for gain in fast_gains(line.table)],
        "starters": [
            {
                "starter": starter.table.name,
                "address": starter.table.address,
                "family": starter.table.family,
                "age_s": {group: round(age_s, 4) for group, age_s in starter.ages_s.items()},
                "longest_gap_s": round(starter.gap_s, 4),
                "watchdog_s": starter.table.watchdog_s,
                **as_json(line, starter),
                "watchdog_margin_s": None if starter.margin_s is None else round(starter.margin_s, 4),
            }
            for starter in line.starters
        ],
        "polls": [
            {
                "poll": each.poll.key,
                "every_s": each.poll.every_s,
                "period_s": round(each.period_s, 4),
                "cost_s": round(each.cost_s, 4),
            }
            for each in line.forecast.polls
        ],
    }
