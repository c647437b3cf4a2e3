"""The arguments of a command: exactly those of its verb, each of its kind, or `bad_arguments`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from gateway.families.refusals import refused

_SWITCH = {"true": True, "on": True, "1": True, "false": False, "off": False, "0": False}


def check_names(args: Mapping[str, Any], names: Sequence[str], optional: Sequence[str] = ()) -> None:
    """Raise CommandError unless there are exactly the arguments of these names, and at most the optional."""
    missing = [f"{name} is missing" for name in names if name not in args]
    strange = [f"{name} is unknown" for name in sorted(set(args) - {*names, *optional})]
    if missing or strange:
        raise refused("bad_arguments", ", ".join(missing + strange))


def text(args: Mapping[str, Any], name: str) -> str:
    """Return an argument that is a text."""
    value = args[name]
    if not isinstance(value, str):
        raise refused("bad_arguments", f"{name} must be a text")
    return value


def switch(args: Mapping[str, Any], name: str) -> bool:
    """Return an argument that is on or off: true, on, 1 or false, off, 0."""
    is_on = to_switch(args[name])
    if is_on is None:
        raise refused("bad_arguments", f"{name} must be true or false")
    return is_on


def to_switch(value: object) -> bool | None:
    """Return whether a value means on or off; None when it means neither."""
    return _SWITCH.get(str(value).casefold())


def choice(args: Mapping[str, Any], name: str, options: Sequence[str]) -> str:
    """Return which of these words an argument is, in any case."""
    wanted = str(args[name]).strip().casefold()
    for option in options:
        if option.casefold() == wanted:
            return option
    raise refused("bad_arguments", f"{name} must be one of {', '.join(options)}")
