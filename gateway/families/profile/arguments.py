"""The arguments of a command: exactly those of its verb, each of its kind, or `bad_arguments`.

A `read` or `set` names one row as `parameter` (and `value`), or several as `parameters`: a list or a table. A
command line writes them as one text: P003,P002 or P314=30,P313=1.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from gateway.contract import CommandError, Note, Reason, ResultCode

_SWITCH = {"true": True, "on": True, "1": True, "false": False, "off": False, "0": False}


def check_names(args: Mapping[str, Any], names: Sequence[str], optional: Sequence[str] = ()) -> None:
    """Raise CommandError unless there are exactly the arguments of these names, and at most the optional."""
    missing = [Note("argument_missing", name=name) for name in names if name not in args]
    strange = [Note("argument_unknown", name=name) for name in sorted(set(args) - {*names, *optional})]
    if missing or strange:
        raise CommandError(Reason(ResultCode.BAD_ARGUMENTS, "names").noted(*missing, *strange))


def text(args: Mapping[str, Any], name: str) -> str:
    """Return an argument that is a text."""
    value = args[name]
    if not isinstance(value, str):
        raise CommandError(ResultCode.BAD_ARGUMENTS, "text", name=name)
    return value


def switch(args: Mapping[str, Any], name: str) -> bool:
    """Return an argument that is on or off: true, on, 1 or false, off, 0."""
    is_on = to_switch(args[name])
    if is_on is None:
        raise CommandError(ResultCode.BAD_ARGUMENTS, "switch", name=name)
    return is_on


def to_switch(value: object) -> bool | None:
    """Return whether a value means on or off; None when it means neither."""
    return _SWITCH.get(str(value).casefold())


def choice(args: Mapping[str, Any], name: str, options: Sequence[str]) -> str:
    """Return which of these words an argument is, in any case."""
    wanted = str(args[name]).strip().casefold()
    found = next((option for option in options if option.casefold() == wanted), None)
    if found is None:
        raise CommandError(ResultCode.BAD_ARGUMENTS, "choice", name=name, options=", ".join(options))
    return found


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
        raise CommandError(ResultCode.BAD_ARGUMENTS, "codes", name=_SEVERAL)
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
        raise CommandError(ResultCode.BAD_ARGUMENTS, "values", name=_SEVERAL)
    _check_count(len(values))
    return dict(values), False


_SEVERAL = "parameters"


def _pair(part: str) -> tuple[str, str]:
    code, sign, value = part.partition("=")
    if not sign:
        raise CommandError(ResultCode.BAD_ARGUMENTS, "pair", part=part[:40])
    return code, value


def _check_count(count: int) -> None:
    if not 1 <= count <= MOST:
        raise CommandError(ResultCode.BAD_ARGUMENTS, "count", name=_SEVERAL, most=MOST)
