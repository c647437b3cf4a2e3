"""What `scan` has found, as a configuration that `check` accepts."""

from __future__ import annotations

from collections.abc import Sequence

from gateway.app.capacity import check_watchdogs
from gateway.cli.scan.search import Find, why_not
from gateway.config.load import parse
from gateway.errors import ConfigError
from gateway.modbus.timing import LineTiming

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
    usable = [find for find in found if find.profile is not None and why_not(find.profile, find.timing) == ""]
    if not usable:
        return ""
    timing = usable[0].timing
    here = [find for find in usable if find.timing == timing]
    rest = [find for find in found if find not in here]
    text = _text(port, timing, here, rest, with_watchdogs=True)
    try:
        parse(text, "scan", check=check_watchdogs)
    except ConfigError:  # a watchdog that this line cannot keep: say so, but do not demand it
        text = _text(port, timing, here, rest, with_watchdogs=False)
    return text


def described(find: Find) -> str:
    """Return in a line who answers, in characters that harm no terminal."""
    if find.profile is None:
        return clean(f"no known starter: {find.identity.reason}")
    identity = find.identity
    facts = [identity.model or find.profile.title]
    facts += [f"firmware {identity.firmware}"] if identity.firmware else []
    facts += [f"serial {identity.serial}"] if identity.serial else []
    return clean(", ".join(facts))


def clean(text: str) -> str:
    """Return a foreign text with printable ASCII only."""
    return "".join(char if " " <= char <= "~" else "?" for char in text)


def _text(
    port: str, timing: LineTiming, here: Sequence[Find], rest: Sequence[Find], *, with_watchdogs: bool
) -> str:
    quoted = '"' + port.replace("\\", "\\\\").replace('"', '\\"') + '"'
    parts = [_HEAD.format(port=quoted, baud=timing.baud, framing=timing.framing)]
    parts += [_starter(find, with_watchdogs=with_watchdogs) for find in sorted(here, key=lambda f: f.address)]
    parts += [_left_out(find) for find in rest]
    return "\n".join(parts)


def _starter(find: Find, *, with_watchdogs: bool) -> str:
    family = "" if find.profile is None else find.profile.family
    lines = [
        f"[[line.starter]] # {described(find)}",
        f'name = "{family}-{find.address}"',
        f"address = {find.address}",
        f'family = "{family}"',
    ]
    if find.watchdogs:
        first = find.watchdogs[0]
        key = f"watchdog_s = {first.after_s} # {first.code}: it {first.does}"
        lines.append(key if with_watchdogs else f"# {key}; this line is too slow for it")
    return "\n".join(lines) + "\n"


def _left_out(find: Find) -> str:
    where = f"# address {find.address} at {find.timing.baud} {find.timing.framing}"
    why = why_not(find.profile, find.timing) if find.profile is not None else ""
    return f"{where}: {described(find)}" + (f" ({why})" if why else "") + "\n"
