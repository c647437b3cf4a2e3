"""Find and identify the starters on a port, and print a configuration for them. Only reads are sent, so it
may be used while motors run; but a request, of whatever kind, starts the communication watchdog of a
starter that has one, and the end of the scan lets it act.

`check` accepts the configuration.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import re
from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import get_args

from gateway.app import io
from gateway.app.capacity import check_watchdogs
from gateway.cli.command import Progress, flag
from gateway.cli.scan.search import (
    ADDRESSES,
    BAUDS,
    FRAMINGS,
    Find,
    Search,
    SearchSettings,
    timings_in_order,
)
from gateway.config import Baud, FramingText, parse
from gateway.errors import ConfigError, UsageError
from gateway.line import new_precise_loop
from gateway.modbus import LineTiming

BY_ID = Path("/dev/serial/by-id")

_RANGE = re.compile(r"(\d+)(?:-(\d+))?")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument("port", metavar="PORT", help="/dev/... or socket://host:port; no gateway may hold it")
    for option, metavar, what, known in (
        ("--baud", "N,..", "rates", BAUDS),
        ("--framing", "F,..", "framings", FRAMINGS),
    ):
        about = f"{what} to try, else {_list(known)}"
        parser.add_argument(option, metavar=metavar, default=_list(known), help=about)
    parser.add_argument("--address", metavar="N-N,..", default="1-247", help="addresses to try, else 1-247")
    parser.add_argument(
        "--reply-within", metavar="S", type=float, default=0.05, help="what a unit may take to answer (0.05)"
    )
    flag(parser, "--all", about="try every setting; else the first one with a find is the last")


def run(args: argparse.Namespace) -> int:
    """Scan, and print the configuration; 1 when no starter was found."""
    settings = settings_of_search(args)
    port = args.port if "://" in args.port else os.path.abspath(args.port)
    progress, open_with = Progress(), partial(io.MACHINE.make_opener, port)
    try:
        with asyncio.Runner(loop_factory=new_precise_loop) as runner:
            found = runner.run(Search(settings, open_with, progress).run())
    finally:
        progress.clear()
    return show(found, stable_name(port), progress)


def show(found: list[Find], port: str, progress: Progress) -> int:
    """Print the configuration on stdout and what else is to be said on stderr; return the exit code."""
    for find in found:
        if find.why_not:
            why = f"{find.why_not} (it may answer at another one: --all)"
            progress.say(f"address {find.address} is left out: {why}")
        for watchdog in find.watchdogs:
            acts = f"after {watchdog.after_s:g} s it {watchdog.does}"
            progress.say(f"address {find.address}: its watchdog {watchdog.code} runs since this scan: {acts}")
    text = config_text(port, found)
    if not text:
        what = "no starter was found" if not found else "nothing that was found can be configured"
        progress.say(f"{what} (is Data+ on Data+? is another master on the line?)")
        return 1
    print(text, end="")
    return 0


def settings_of_search(args: argparse.Namespace) -> SearchSettings:
    """Return what to search; UsageError for what cannot be."""
    rates, formats = {str(each): each for each in get_args(Baud)}, get_args(FramingText)
    bauds, framings = _split(args.baud), _split(args.framing.upper())
    for option, texts, known in (("--baud", bauds, rates), ("--framing", framings, formats)):
        if wrong := next((each for each in texts if each not in known), None):
            raise UsageError(f"{option} {wrong!r} is none of a line (one of {_list(known)})")
    if not 0.005 <= args.reply_within <= 10:
        raise UsageError(f"--reply-within {args.reply_within} is out of range (0.005..10)")
    return SearchSettings(
        timings=timings_in_order([rates[each] for each in bauds], framings),
        addresses=addresses_in(args.address),
        response_time_s=args.reply_within,
        goes_on=args.all,
    )


def addresses_in(text: str) -> tuple[int, ...]:
    """Return the addresses of a text such as 1-16,20; UsageError when it is none."""
    found: dict[int, None] = {}
    for part in _split(text):
        match = _RANGE.fullmatch(part)
        first, last = (int(match[1]), int(match[2] or match[1])) if match else (0, 0)
        if first not in ADDRESSES or last not in ADDRESSES or first > last:
            raise UsageError(f"--address {part!r} is no address (1-247, or e.g. 1-16,20)")
        found |= dict.fromkeys(range(first, last + 1))
    if not found:
        raise UsageError("--address names no address (e.g. 1-247)")
    return tuple(found)


def stable_name(port: str, by_id: Path = BY_ID) -> str:
    """Return the name under which the same adapter is found tomorrow, the port's own when there is none."""
    if "://" in port or not by_id.is_dir():
        return port
    real = Path(port).resolve()
    return next((str(each) for each in sorted(by_id.iterdir()) if each.resolve() == real), port)


def _split(text: str) -> list[str]:
    return [part.strip() for part in text.split(",") if part.strip()]


def _list(values: Iterable[object]) -> str:
    return ", ".join(str(value) for value in values)


_HEAD = """\
# Found by `starter-gateway scan`. Give gateway, line and starters their names, and name the broker.
# There is no [[operator]]: a gateway with this configuration only reads.

[gateway]
name = "gateway-1"

[mqtt]
url = "mqtt://127.0.0.1:1883"

[[line]]
name = "line-1"
port = {port}
baud = {baud}
framing = "{framing}"
"""


def config_text(port: str, found: Sequence[Find]) -> str:
    """Return the configuration; "" when none of the finds is a starter that a line can have."""
    usable = [find for find in found if find.profile is not None and not find.why_not]
    if not usable:
        return ""
    text = _text(port, usable[0].timing, found)
    try:
        parse(text, "scan", check=check_watchdogs)
    except ConfigError:  # a watchdog that this line cannot keep: say so, but do not demand it
        text = re.sub(r"(?m)^watchdog_s.*", r"# \g<0>; this line is too slow for it", text)
    return text


def _text(port: str, timing: LineTiming, found: Sequence[Find]) -> str:
    """Return a line of the starters at this timing; the other finds are comments at its end."""
    parts, others = [_HEAD.format(port=json.dumps(port), baud=timing.baud, framing=timing.framing)], []
    for find in sorted(found, key=lambda find: find.address):
        if find.profile is None or find.why_not or find.timing != timing:
            why = f" ({find.why_not})" if find.why_not else ""
            where = f"# address {find.address} at {find.timing.baud} {find.timing.framing}"
            others += [f"{where}: {find.described}{why}", ""]
            continue
        family = find.profile.family
        parts += [f"[[line.starter]] # {find.described}", f'name = "{family}-{find.address}"']
        parts += [f"address = {find.address}", f'family = "{family}"']
        for first in find.watchdogs[:1]:
            parts.append(f"watchdog_s = {first.after_s} # {first.code}: it {first.does}")
        parts.append("")
    return "\n".join([*parts, *others])
