"""The arguments of a command: exactly those of its verb, each of its kind, or `bad_arguments`.

A `read` or `set` names one row as `parameter` (and `value`), or several as `parameters`: a list or a table. A
command line writes them as one text: P003,P002 or P314=30,P313=1.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from gateway.families.profile.procedure import refused

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


MOST = 64  # rows at once; a larger set is a matter of minutes on a slow line


def asked_codes(args: Mapping[str, Any]) -> tuple[tuple[str, ...], bool]:
    """Return the codes of a `read`, and whether it is a single one asked for as such."""
    if _SEVERAL not in args:
        check_names(args, ("parameter",))
        return (text(args, "parameter"),), True
    check_names(args, (_SEVERAL,))
    asked = args[_SEVERAL]
    codes = asked.split(",") if isinstance(asked, str) else asked
    if not isinstance(codes, (list, tuple)) or not all(isinstance(code, str) for code in codes):
        raise refused("bad_arguments", f"{_SEVERAL} must be a list of codes")
    _check_count(len(codes))
    return tuple(codes), False


def asked_values(args: Mapping[str, Any]) -> tuple[dict[str, Any], bool]:
    """Return the values of a `set` by code, and whether it is a single one asked for as such."""
    if _SEVERAL not in args:
        check_names(args, ("parameter", "value"))
        return {text(args, "parameter"): args["value"]}, True
    check_names(args, (_SEVERAL,))
    asked = args[_SEVERAL]
    values = dict(_pair(part) for part in asked.split(",")) if isinstance(asked, str) else asked
    if not isinstance(values, Mapping):
        raise refused("bad_arguments", f"{_SEVERAL} must be a table of values by code")
    _check_count(len(values))
    return dict(values), False


_SEVERAL = "parameters"


def _pair(part: str) -> tuple[str, str]:
    code, sign, value = part.partition("=")
    if not sign:
        raise refused("bad_arguments", f"{part[:40]!r} is not CODE=VALUE")
    return code, value


def _check_count(count: int) -> None:
    if not 1 <= count <= MOST:
        raise refused("bad_arguments", f"{_SEVERAL} takes 1 to {MOST} rows")
