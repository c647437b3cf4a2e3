"""`starter-gateway check`: validates a configuration and prints what each line will do.

Nothing is opened; what `doctor` measured of this machine is read from state_dir.
For each line: load, sweep time, value ages and stop latency. For each starter: the longest time without a
request while the gateway works, after it crashes and while it hangs, and whether its watchdog outlasts that.
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import Any

from gateway.app.capacity import (
    LineCapacity,
    StarterCapacity,
    extra_cost_of,
    prospects_of,
)
from gateway.app.restart import planned_gaps
from gateway.app.site import Site
from gateway.cli.command import counted, flag
from gateway.cli.doctor.findings import Finding, Findings
from gateway.cli.doctor.machine import dated_finding
from gateway.cli.scan.scan import stable_name
from gateway.config.schema import Config, LineTable
from gateway.errors import ConfigError, StartError
from gateway.families import ENGLISH, LANGUAGES, Weight, languages_of, load_profile
from gateway.line import capacity
from gateway.store import backup
from gateway.system.instance_lock import is_locked

RESTART_LATER = 75  # EX_TEMPFAIL of sysexits.h
SHORTEST_LIMIT_S = 2.0  # of the service watchdog: a slow line needs most of a second for one transaction
_SAFE_FACTOR = 1.5  # a watchdog below this many longest gaps leaves little room for commands and retries


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's description and arguments."""
    parser.description = "Validate a configuration and print the budget of its lines; nothing is opened."
    parser.add_argument("config", metavar="CONFIG", help="the configuration file")
    flag(
        parser,
        "--upgrade",
        about="look instead at whether this version may replace the one that runs: exit 0 when it accepts "
        "configuration and state and no watchdog acts during a restart, 78 when it does not accept them, 75 "
        "when a restart takes too long for a watchdog",
    )
    flag(parser, "--json", about="print the same as JSON")


def run(args: argparse.Namespace) -> int:
    """Print the budget and the warnings; the caller prints the problems of a wrong configuration."""
    try:
        site = Site.read(Path(args.config), os.environ)
    except ConfigError as error:
        if args.json:
            _print_json(args.config, is_valid=False, problems=_problems(error))
        raise
    if args.upgrade:
        return _check_upgrade(args.config, site, as_json=args.json)
    config, prospects = site.config, prospects_of(site.config)
    overloads, others = list(_overloads(prospects)), list(filter(None, _warnings(site, prospects)))
    if args.json:
        _print_json(
            args.config,
            is_valid=True,
            language=language_line(config),
            lines=[_as_json(line) for line in prospects],
            warnings=[warning.said for warning in (*overloads, *others)],
        )
        return 0
    findings = Findings()
    findings.add(*overloads)
    print(f"{args.config}: valid, {_site(config)}")
    print(language_line(config))
    for line in prospects:
        _print_line(line)
    findings.add(*others)
    return 0


def _check_upgrade(path: str, site: Site, *, as_json: bool) -> int:
    """Print what a restart with this version would do; NewerError, ConfigError, StartError."""
    _require_sight(site.state_dir)
    backup.refuse_newer(site.state_dir)
    is_running = is_locked(site.state_dir, if_unseen=True)
    gaps = planned_gaps(site)
    tight = [gap for gap in gaps if not gap.is_safe] if is_running else []
    if as_json:
        _print_json(
            path,
            is_valid=True,
            is_running=is_running,
            starters=[gap.to_dict() for gap in gaps],
            is_restart_safe=not tight,
        )
        return RESTART_LATER if tight else 0
    print(f"{path}: accepted, and so is the state in {site.state_dir}")
    if not is_running:
        print("no gateway runs with this state_dir: a start interrupts nothing")
    for gap in tight:
        print(
            f"{gap.starter}: a restart may leave it without a request for {gap.gap_s:.1f} s "
            f"at the worst; its watchdog of {gap.limit_s:g} s is "
            f"{gap.wanted_s - (gap.limit_s or 0.0):.1f} s too short to be safe"
        )
    if tight:
        print("stop these motors first, or make their watchdogs longer; then restart the service")
        return RESTART_LATER
    longest = max(gaps, key=lambda gap: gap.gap_s, default=None)
    if is_running and longest is not None:
        print(f"a restart is safe: no starter is without a request for more than {longest.gap_s:.1f} s")
    return 0


def _require_sight(state_dir: Path) -> None:
    """Raise StartError where this user may not look: nothing would seem to be there, and none to run."""
    try:
        os.listdir(state_dir)
    except PermissionError as error:
        what = f"state_dir {state_dir}: this user may not look into it"
        raise StartError(what, "run this as the gateway's user, or as root") from error
    except OSError:  # there is none yet
        return


def _print_json(path: str, **content: Any) -> None:
    print(json.dumps({"config": path, **content}, indent=2))


def _site(config: Config) -> str:
    starters = counted(len(config.starters), "starter")
    clients = len({operator.client for operator in config.operators})
    rights = counted(clients, "operator") if clients else "read-only"
    return f"{starters} on {counted(len(config.lines), 'line')}, {rights}"


def language_line(config: Config) -> str:
    """Return in which language names are published, and which families have which others."""
    families = sorted({each.family for each in config.starters})
    wanted = config.gateway.language
    lacking = [each for each in families if wanted not in languages_of(each)]
    fallback = f"; {', '.join(lacking)} in English, since no manual of theirs is in it" if lacking else ""
    others = [
        f"{language} ({', '.join(having) or 'no family'})"
        for language in LANGUAGES
        if language not in (ENGLISH, wanted)
        for having in [[each for each in families if language in languages_of(each)]]
    ]
    return f'names in language = "{wanted}"{fallback}; there are also: {", ".join(others)}'


def gaps_of_starter(starter: StarterCapacity, restart: capacity.Restart | None = None) -> capacity.Gaps:
    """Return the longest gaps of a starter, with the shipped unit's times unless others are given."""
    return capacity.gaps_of(starter.gap_s, starter.first_poll_s, restart)


def _print_line(line: LineCapacity) -> None:
    table, whole = line.table, line.forecast
    print(f"\nline {table.name}: {table.port}, {table.baud} {table.framing}")
    stop = f"a stop waits at most {whole.stop_latency_s:.3f} s"
    print(f"  load {whole.load:.0%}, sweep {whole.sweep_s:.3f} s, {stop}")
    _print_extra(table)
    if not line.starters:
        return
    width = max(7, *(len(starter.table.name) for starter in line.starters))
    print(f"  {'':{width}}                longest time without a request when the gateway")
    print(f"  {'starter':{width}}  addr  family      works     crashes      hangs   watchdog")
    for starter in line.starters:
        each, gaps = starter.table, gaps_of_starter(starter)
        times = "  ".join(f"{gap_s:7.2f} s" for gap_s in (gaps.regular_s, gaps.crash_s, gaps.hang_s))
        print(
            f"  {each.name:{width}}  {each.address:4}  {each.family:6}  {times}   {_watchdog(starter, gaps)}"
        )


def _watchdog(starter: StarterCapacity, gaps: capacity.Gaps) -> str:
    limit_s = starter.table.watchdog_s
    if limit_s is None:
        return f"not stated, must be above {starter.gap_s:.2f} s"
    if not limit_s or starter.margin_s is None:
        return "off"
    for_crash_s, for_hang_s = gaps.wanted_s
    outlasts = "nothing" if limit_s < for_crash_s else "a crash" if limit_s < for_hang_s else "both"
    return f"{limit_s:g} s, {starter.margin_s:.2f} s to spare, outlasts {outlasts}"


def _warning(where: str, text: str, remedy: str) -> Finding:
    return Finding(where, text, Weight.WARNING, remedy)


def _overloads(prospects: tuple[LineCapacity, ...]) -> Iterator[Finding]:
    """Say which lines are asked for more than their time: before all else, since nothing else then holds."""
    for line in prospects:
        whole = line.forecast
        if whole.is_overloaded:
            what = f"asked for {whole.load:.0%} of its time, periods become {whole.factor:.1f} times as long"
            remedy = "a higher baud, fewer starters on the line, or an every_s that is as much longer"
            yield _warning(f"line {line.table.name}", what, remedy)


def _warnings(site: Site, prospects: tuple[LineCapacity, ...]) -> Iterator[Finding | None]:
    """Yield whatever a person should know before the gateway runs by this configuration."""
    for line in prospects:
        yield from _segment_warnings(line.table)
        for starter in line.starters:
            yield _watchdog_warning(starter)
    config, folder = site.config, site.folder
    for where, name in product(("mqtt", "web", "sparkplug"), ("ca_file", "cert_file", "key_file")):
        file = getattr(getattr(config, where), name, None)
        if file is not None and not (folder / file).exists():
            yield _warning(f"{where}.{name}", f"{folder / file} is not there", "put it there before `run`")
    for table in config.lines:
        if table.port.startswith(("/dev/ttyUSB", "/dev/ttyACM")):
            stable = stable_name(table.port)
            name = "a name below /dev/serial/by-id" if stable == table.port else stable
            what = f"{table.port} may be another adapter tomorrow"
            yield _warning(f"line {table.name}", what, f"use {name}")
    sparkplug = config.sparkplug
    if sparkplug is not None and sparkplug.commands:
        who = f"every Sparkplug host is the same person, operator {sparkplug.operator}"
        topic = f"spBv1.0/{sparkplug.group}/DCMD/{sparkplug.node or config.gateway.name}/#"
        remedy = f"let the broker's access list say who may write {topic}"
        yield _warning("sparkplug.commands", who, remedy)
    yield dated_finding(config)
    if config.mqtt.allow_plaintext and not config.mqtt.is_tls:
        yield _warning("mqtt.url", "passwords and commands cross the network unencrypted", "use mqtts://")


def _segment_warnings(table: LineTable) -> Iterator[Finding]:
    """Say that a line has more devices than a manual allows without a repeater; disabled ones count."""
    limits = {
        profile.title: limit
        for profile in (load_profile(starter.family) for starter in table.starters)
        if (limit := profile.limits.segment_devices) is not None
    }
    title, most = min(limits.items(), key=lambda pair: pair[1], default=("", len(table.starters)))
    if len(table.starters) > most:
        what = f"{len(table.starters)} starters need a repeater, {title} allows {most} without"
        yield _warning(f"line {table.name}", what, "put one in, or use more lines")


def _watchdog_warning(starter: StarterCapacity) -> Finding | None:
    """Say that a watchdog is too tight while everything works, else for which failure of the gateway."""
    limit_s, where, gaps = starter.table.watchdog_s, f"starter {starter.table.name}", gaps_of_starter(starter)
    if not limit_s:
        return None
    for_crash_s, for_hang_s = gaps.wanted_s
    what = f"its watchdog of {limit_s:g} s acts when the gateway"
    if limit_s < _SAFE_FACTOR * starter.gap_s:
        what = f"its watchdog of {limit_s:g} s has {starter.margin_s:.2f} s to spare"
        return _warning(where, what, f"make it {_SAFE_FACTOR * starter.gap_s:.1f} s, or every_s shorter")
    if limit_s < for_crash_s:
        gap = f"crashes: {gaps.crash_s:.1f} s without a request"
        return _warning(where, f"{what} {gap}", f"make it {for_crash_s:.1f} s, or every_s shorter")
    if limit_s < for_hang_s:
        gap = f"hangs: {gaps.hang_s:.1f} s without a request"
        return _warning(where, f"{what} {gap}", f"make it {for_hang_s:.1f} s{_shorter(limit_s, gaps)}")
    return None


def _shorter(limit_s: float, gaps: capacity.Gaps) -> str:
    """Return which setting of the service would do as well, if any."""
    spare_s = limit_s / capacity.WIDE_FACTOR - gaps.crash_s - capacity.LOOK_S - capacity.Restart().abort_s
    service_s = int(spare_s / (1.0 + 1.0 / capacity.FEEDS))
    return f", or WatchdogSec={service_s}s in the service" if service_s >= SHORTEST_LIMIT_S else ""


def _problems(error: ConfigError) -> list[dict[str, Any]]:
    keys = ("hint", "mend")  # the second is its name of before 0.2: keys are only added
    return [
        {"line": p.line, "key": p.key, "what": p.what, **dict.fromkeys(keys, p.hint)} for p in error.problems
    ]


def _print_extra(table: LineTable) -> None:
    """Print what the points cost that the configuration asks for, where it asks for some."""
    if not any(each.asked for each in table.starters):
        return
    cost = extra_cost_of(table)
    counts = ", ".join(f"{name} {count}" for name, count in cost.points.items() if count) or "none"
    print(f"  points asked for: {counts}; {counted(cost.reads, 'read')} more, {cost.load:.1%} of its time")
    for name, codes in cost.already.items():
        if codes:
            print(f"  {name} has as points already: {', '.join(codes)}")


def _extra_json(table: LineTable) -> dict[str, Any]:
    cost = extra_cost_of(table)
    return {"count": sum(cost.points.values()), "reads": cost.reads, "load": round(cost.load, 4)}


def _as_json(line: LineCapacity) -> dict[str, Any]:
    return {
        "line": line.table.name,
        "load": round(line.forecast.load, 4),
        "is_overloaded": line.forecast.is_overloaded,
        "watchdog_load": round(line.forecast.watchdog_load, 4),
        "sweep_s": round(line.forecast.sweep_s, 4),
        "stop_latency_s": round(line.forecast.stop_latency_s, 4),
        "extra_points": _extra_json(line.table),
        "starters": [
            {
                "starter": starter.table.name,
                "address": starter.table.address,
                "family": starter.table.family,
                "longest_gap_s": round(starter.gap_s, 4),
                "watchdog_s": starter.table.watchdog_s,
                "crash_gap_s": round(gaps.crash_s, 4),
                "hang_gap_s": round(gaps.hang_s, 4),
                "watchdog_margin_s": None if starter.margin_s is None else round(starter.margin_s, 4),
            }
            for starter in line.starters
            for gaps in [gaps_of_starter(starter)]
        ],
    }
