"""Validate a configuration and print the budget of its lines; nothing is opened.

For each line: load, sweep time and stop latency. For each starter: the longest time
without a request while the gateway works, after it crashes and while it hangs, and whether its watchdog
outlasts that.
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import Any

from gateway.app.capacity import LineCapacity, StarterCapacity, extra_cost_of
from gateway.app.restart import planned_gaps
from gateway.app.site import Site
from gateway.cli.command import counted, flag
from gateway.cli.doctor.findings import Finding, Findings
from gateway.cli.doctor.machine import dated_finding
from gateway.cli.scan.scan import stable_name
from gateway.config import Config
from gateway.errors import ConfigError, StartError
from gateway.families import Weight, load_profile
from gateway.line import capacity
from gateway.store import backup
from gateway.system.instance_lock import is_locked

RESTART_LATER = 75  # EX_TEMPFAIL of sysexits.h
_SAFE_FACTOR = 1.5  # a watchdog below this many longest gaps leaves little room for commands and retries


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
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
    warnings = list(filter(None, _warnings(site)))
    if args.json:
        lines, said = [_as_json(line) for line in site.prospects], [warning.said for warning in warnings]
        _print_json(args.config, is_valid=True, lines=lines, warnings=said)
        return 0
    print(f"{args.config}: valid, {_site(site.config)}")
    for line in site.prospects:
        _print_line(line)
    print("" if warnings else "\nno warnings")
    Findings().add(*warnings)
    return 0


def gaps_of_starter(starter: StarterCapacity, restart: capacity.Restart | None = None) -> capacity.Gaps:
    """Return the longest gaps of a starter, with the shipped unit's times unless others are given."""
    return capacity.gaps_of(starter.gap_s, starter.first_poll_s, restart)


def _check_upgrade(path: str, site: Site, *, as_json: bool) -> int:
    """Print what a restart with this version would do; NewerError, ConfigError, StartError."""
    try:
        os.listdir(site.state_dir)
    except PermissionError as error:  # nothing would seem to be there, and no gateway to run
        what = f"state_dir {site.state_dir}: this user may not look into it"
        raise StartError(what, "run this as the gateway's user, or as root") from error
    except OSError:
        pass  # there is none yet
    backup.found_versions(site.state_dir)  # of which none may be later
    is_running, gaps = is_locked(site.state_dir, if_unseen=True), planned_gaps(site)
    tight = [gap for gap in gaps if not gap.is_safe] if is_running else []
    if as_json:
        starters = [gap.to_dict() for gap in gaps]
        _print_json(path, is_valid=True, is_running=is_running, starters=starters, is_restart_safe=not tight)
        return RESTART_LATER if tight else 0
    print(f"{path}: accepted, and so is the state in {site.state_dir}")
    for gap in tight:
        missing_s = gap.wanted_s - (gap.limit_s or 0.0)
        print(
            f"{gap.starter}: a restart may leave it without a request for {gap.gap_s:.1f} s at the worst;"
            f" its watchdog of {gap.limit_s:g} s is {missing_s:.1f} s too short to be safe"
        )
    if tight:
        print("stop these motors first, or make their watchdogs longer; then restart the service")
        return RESTART_LATER
    longest_s = max((gap.gap_s for gap in gaps), default=0.0)
    if is_running:
        print(f"a restart is safe: no starter is without a request for more than {longest_s:.1f} s")
    else:
        print("no gateway runs with this state_dir: a start interrupts nothing")
    return 0


def _site(config: Config) -> str:
    clients = len({operator.client for operator in config.operators})
    rights = counted(clients, "operator") if clients else "read-only"
    return f"{counted(len(config.starters), 'starter')} on {counted(len(config.lines), 'line')}, {rights}"


def _print_line(line: LineCapacity) -> None:
    table, whole = line.table, line.forecast
    print(f"\nline {table.name}: {table.port}, {table.baud} {table.framing}")
    stop = f"a stop waits at most {whole.stop_latency_s:.3f} s"
    print(f"  load {whole.load:.0%}, sweep {whole.sweep_s:.3f} s, {stop}")
    if any(each.asked for each in table.starters):
        cost = extra_cost_of(table)
        counts = ", ".join(f"{name} {count}" for name, count in cost.points.items() if count) or "none"
        more = f"{counted(cost.reads, 'read')} more, {cost.load:.1%} of its time"
        print(f"  points asked for: {counts}; {more}")
        for name, codes in cost.already.items():
            if codes:
                print(f"  {name} has as points already: {', '.join(codes)}")
    if not line.starters:
        return
    width = max(7, *(len(starter.table.name) for starter in line.starters))
    print(f"  {'':{width}}                longest time without a request when the gateway")
    print(f"  {'starter':{width}}  addr  family      works     crashes      hangs   watchdog")
    for starter in line.starters:
        each, gaps = starter.table, gaps_of_starter(starter)
        times = "  ".join(f"{gap_s:7.2f} s" for gap_s in (gaps.regular_s, gaps.crash_s, gaps.hang_s))
        known = f"  {each.name:{width}}  {each.address:4}  {each.family:6}  {times}"
        print(f"{known}   {_watchdog(starter, gaps)[0]}")


def _watchdog(starter: StarterCapacity, gaps: capacity.Gaps) -> tuple[str, Finding | None]:
    """Return a watchdog in words, and a warning when it is too tight or acts when the gateway fails."""
    limit_s = starter.table.watchdog_s
    if limit_s is None:
        return f"not stated, must be above {starter.gap_s:.2f} s", None
    if not limit_s or starter.margin_s is None:
        return "off", None
    for_crash_s, for_hang_s = gaps.wanted_s
    outlasts = "nothing" if limit_s < for_crash_s else "a crash" if limit_s < for_hang_s else "both"
    warning, acts = None, "acts when the gateway"
    for wanted_s, what in (
        (_SAFE_FACTOR * starter.gap_s, f"has {starter.margin_s:.2f} s to spare"),
        (for_crash_s, f"{acts} crashes: {gaps.crash_s:.1f} s without a request"),
        (for_hang_s, f"{acts} hangs: {gaps.hang_s:.1f} s without a request"),
    ):
        if limit_s < wanted_s:
            where, text = f"starter {starter.table.name}", f"its watchdog of {limit_s:g} s {what}"
            warning = _warning(where, text, f"make it {wanted_s:.1f} s, or every_s shorter")
            break
    return f"{limit_s:g} s, {starter.margin_s:.2f} s to spare, outlasts {outlasts}", warning


def _warnings(site: Site) -> Iterator[Finding | None]:
    """Yield whatever a person should know before the gateway runs by this configuration."""
    config, folder = site.config, site.folder
    adapters: dict[str, str] = {}  # by the name behind all links
    for table in config.lines:
        first = adapters.setdefault(os.path.realpath(table.port), table.name)
        if first != table.name:
            remedy = "put all starters of a port under one [[line]]"
            yield _warning(f"line {table.name}", f"its port is that of line {first}", remedy)
    for line in site.prospects:
        yield from _line_warnings(line)
        for starter in line.starters:
            yield _watchdog(starter, gaps_of_starter(starter))[1]
    for where, name in product(("mqtt", "web", "sparkplug"), ("ca_file", "cert_file", "key_file")):
        file = getattr(getattr(config, where), name, None)
        if file is None:
            continue
        if not (folder / file).exists():
            yield _warning(f"{where}.{name}", f"{folder / file} is not there", "put it there before `run`")
        elif not os.access(folder / file, os.R_OK):
            yield _warning(f"{where}.{name}", f"{folder / file} may not be read", "let this user read it")
    sparkplug = config.sparkplug
    if sparkplug is not None and sparkplug.commands:
        who = f"every Sparkplug host is the same person, operator {sparkplug.operator}"
        topic = f"spBv1.0/{sparkplug.group}/DCMD/{sparkplug.node or config.gateway.name}/#"
        remedy = f"let the broker's access list say who may write {topic}"
        yield _warning("sparkplug.commands", who, remedy)
    yield dated_finding(config)
    if config.mqtt.allow_plaintext and not config.mqtt.is_tls:
        yield _warning("mqtt.url", "passwords and commands cross the network unencrypted", "use mqtts://")


def _line_warnings(line: LineCapacity) -> Iterator[Finding]:
    """Yield whether a line is asked for too much, its port's name lasts, and a repeater is missing."""
    table, whole, where = line.table, line.forecast, f"line {line.table.name}"
    if whole.is_overloaded:
        what = f"asked for {whole.load:.0%} of its time, periods become {whole.factor:.1f} times as long"
        yield _warning(
            where, what, "a higher baud, fewer starters on the line, or an every_s that is as much longer"
        )
    if table.port.startswith(("/dev/ttyUSB", "/dev/ttyACM")):
        stable = stable_name(table.port)
        name = "a name below /dev/serial/by-id" if stable == table.port else stable
        yield _warning(where, f"{table.port} may be another adapter tomorrow", f"use {name}")
    profiles = [load_profile(starter.family) for starter in table.starters]
    limits = [(each.limits.segment_devices or len(profiles), each.title) for each in profiles]
    most, title = min(limits, default=(0, ""))
    if len(profiles) > most:
        what = f"{len(profiles)} starters need a repeater, {title} allows {most} without"
        yield _warning(where, what, "put one in, or use more lines")


def _warning(where: str, text: str, remedy: str) -> Finding:
    return Finding(where, text, Weight.WARNING, remedy)


def _print_json(path: str, **content: Any) -> None:
    print(json.dumps({"config": path, **content}, indent=2))


def _problems(error: ConfigError) -> list[dict[str, Any]]:
    keys = ("hint", "mend")  # the second is its name until 0.1: keys are only added
    return [
        {"line": p.line, "key": p.key, "what": p.what, **dict.fromkeys(keys, p.hint)} for p in error.problems
    ]


def _as_json(line: LineCapacity) -> dict[str, Any]:
    whole, extra = line.forecast, extra_cost_of(line.table)
    loads = {"load": whole.load, "watchdog_load": whole.watchdog_load}
    times = {"sweep_s": whole.sweep_s, "stop_latency_s": whole.stop_latency_s}
    points = {"count": sum(extra.points.values()), "reads": extra.reads, "load": round(extra.load, 4)}
    return {
        "line": line.table.name,
        "is_overloaded": whole.is_overloaded,
        **{key: round(value, 4) for key, value in {**loads, **times}.items()},
        "extra_points": points,
        "starters": [_starter_json(starter) for starter in line.starters],
    }


def _starter_json(starter: StarterCapacity) -> dict[str, Any]:
    table, gaps, margin_s = starter.table, gaps_of_starter(starter), starter.margin_s
    times = {"longest_gap_s": starter.gap_s, "crash_gap_s": gaps.crash_s, "hang_gap_s": gaps.hang_s}
    return {
        "starter": table.name,
        "address": table.address,
        "family": table.family,
        "watchdog_s": table.watchdog_s,
        "watchdog_margin_s": None if margin_s is None else round(margin_s, 4),
        **{key: round(value, 4) for key, value in times.items()},
    }
