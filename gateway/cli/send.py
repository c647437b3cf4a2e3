"""Send a command over MQTT and show its phases; exit code 0 only when it is confirmed."""

from __future__ import annotations

import argparse
import asyncio
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gateway.cli.broker import add_login, operator_at
from gateway.cli.command import KEY_VALUE, add_starter, assigned, choose, completed, targets
from gateway.config import Config, load
from gateway.contract import OWN_VERBS, SELECT, STOP, Phase, ResultRecord, is_level
from gateway.errors import UsageError
from gateway.families import command, load_profile

EXPECT = "POINT:VALUE,.. (e.g. expect=state:ready,remote:true)"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add_starter(parser, about="the starter's name, or a group's for a stop")
    verb = parser.add_argument("verb", metavar="VERB", help="start, stop, reset, set, read ...")
    completed(verb, by=_verbs)
    parser.add_argument(
        "args",
        metavar="KEY=VALUE",
        nargs="*",
        default=[],  # argparse would call it required
        help="e.g. parameter=P314 value=30; select=TOKEN as `select verb=start` has printed it; "
        "expect=state:ready,remote:true, without which nothing is done",
    )
    add_login(parser, client="the operator; may be left out when there is only one")
    parser.add_argument(
        "--timeout", metavar="S", type=float, default=30.0, help="seconds to wait for the end, more than 0"
    )


def run(args: argparse.Namespace) -> int:
    """Send, print each phase on a line, and return 0 only for a confirmed command."""
    if not args.timeout > 0:
        raise UsageError(f"--timeout {args.timeout:g} leaves no time for a result: nothing was sent")
    config = load(args.config)
    known = targets(config)
    if args.starter not in known:
        raise UsageError(f"no starter {args.starter!r} ({choose(args.starter, known)})")
    if not is_level(args.verb):
        raise UsageError(f"no verb {args.verb!r} (start, stop, reset, set, read ...)")
    values: dict[str, Any] = dict(assigned(args.args, sign="=", form=KEY_VALUE, texts=("select", "expect")))
    select, expect = values.pop("select", None), values.pop("expect", "")
    expected = assigned(expect.split(","), sign=":", form=EXPECT) if expect else {}
    if args.verb == SELECT and "verb" in values:
        target = values.pop("verb")
        values = {"verb": target, "args": values} if values else {"verb": target}
    operator = operator_at(config, Path(args.config).parent, args)
    sending = operator.command(
        args.starter,
        args.verb,
        values,
        expect=expected,
        select=select,
        within_s=args.timeout,
        on_phase=_show,
    )
    result = asyncio.run(sending)
    _show(result)
    if "select" in result.values and args.verb == SELECT:
        print(f"select={result.values['select']} (within {result.values.get('valid_s')} s)", flush=True)
    return 0 if result.phase is Phase.CONFIRMED else 1


def _verbs(config: Config, args: argparse.Namespace) -> tuple[str, ...]:
    """Return the verbs of the named starter; a group has one."""
    family = {starter.name: starter.family for starter in config.starters}.get(args.starter)
    return (STOP,) if family is None else (*command.verbs(load_profile(family)), *OWN_VERBS)


def _show(result: ResultRecord) -> None:
    """Print one phase: what the gateway said of it, and the value when it read one."""
    phase, code, values = str(result.phase), result.code, result.values
    text = result.text.removeprefix(phase).lstrip("; ")
    line = phase if code in ("", "ok", phase) else f"{phase} [{code}]"
    if text:
        line += f": {text}"
    if "value" in values:
        line += f" = {_readable(values)}"
    print(line, flush=True)
    for parameter, value in (values.get("values") or {}).items():
        print(f"  {parameter} = {_readable(value)}", flush=True)


def _readable(value: Mapping[str, Any]) -> str:
    """Return a value with its unit, or what the manual calls it; the raw words of one that means nothing."""
    if value["value"] is None and value.get("raw"):
        return f"{' '.join(map(str, value['raw']))} raw ({value.get('reason') or 'no value'})"
    return str(value.get("label") or f"{value['value']} {value.get('unit') or ''}".rstrip())
