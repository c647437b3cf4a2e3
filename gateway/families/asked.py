"""Which rows a `read` or `set` asks for: one as `parameter` (and `value`), several as `parameters`.

Several are a list or a table; a command line writes them as one text: P003,P002 or P314=30,P313=1.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gateway.families.arguments import check_names, text
from gateway.families.refusals import refused

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
