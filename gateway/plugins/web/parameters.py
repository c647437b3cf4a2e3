"""A family's rows for the status page: what each may be set to, and why some may not."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import lru_cache
from typing import Any

from gateway.contract import CommandError
from gateway.families.command.build import prepare
from gateway.families.profile.load import load_profile
from gateway.families.profile.parameters import raw_limits, settable_words
from gateway.families.profile.rows import OFF, Access, Parameter
from gateway.families.profile.schema import Profile, Variant


def rows_of(profile: Profile, variant: Variant) -> Iterator[dict[str, Any]]:
    """Yield every row that can be read, in the manual's order."""
    for row in profile.parameters.values():
        if row.access is Access.NONE:
            continue
        limits = raw_limits(row, variant)
        scale = 10 ** (row.decimals or 0)
        labels = {str(number): label for number, label in profile.enums.get(row.enum, {}).items()}
        why_not = _why_not_set(profile, variant, row)
        yield {
            "code": row.code,
            "name": row.name,
            "unit": row.unit,
            "least": None if limits is None else limits[0] / scale,
            "most": None if limits is None else limits[1] / scale,
            "labels": {**labels, **({str(row.off): OFF} if row.off is not None else {})},
            "writable": not why_not,
            "why_not": why_not,
        }


@lru_cache(maxsize=32)
def sample_args(family: str, verb: str) -> Mapping[str, Any]:
    """Return arguments of a `read` or `set` that make sense for any starter of a family."""
    profile = load_profile(family)
    for row in profile.parameters.values():
        args: dict[str, Any] = {"parameter": row.code}
        if verb == "set":
            if not row.is_writable or row.is_stopped_only or row.raw_min is None:
                continue
            args["value"] = _least(row)
        try:
            prepare(profile, Variant(), verb, args)
        except CommandError:
            continue
        return args
    return {}


def _why_not_set(profile: Profile, variant: Variant, row: Parameter) -> str:
    """Return why no `set` may name a row; empty when one may."""
    try:
        settable_words(profile, variant, row, _least(row))
    except CommandError as error:
        return "" if error.code in ("out_of_range", "bad_value") else error.text
    return ""


def _least(row: Parameter) -> float:
    return float((row.raw_min or 0) / 10 ** (row.decimals or 0))
