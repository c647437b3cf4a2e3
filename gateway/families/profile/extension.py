"""The additions of a site to a family: readable rows as points, and rows from a manual of its own.

An extended profile serves wherever the family's own does, so that readings, commands and copies of the
parameters follow from it. A row of a site never replaces one of the family's manual, nor one that is polled,
and is never to be set where that would choose who commands the motor or cut the connection.
"""

from __future__ import annotations

import difflib
import fnmatch
import re
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

from gateway.contract import to_level
from gateway.families.profile.decode import point_of
from gateway.families.profile.parameters import is_named, raw_row, spelt
from gateway.families.profile.rows import Access, Model, Parameter
from gateway.families.profile.schema import Point, Profile, remade

EXTRA = "extra"  # the group of the points that a site asks for
_NUMBERED = re.compile(r"P([0-9]{3})")


class SiteRow(Model):
    """A row that a site describes, and what its point is called."""

    row: Parameter
    point: str


class SitePoint(NamedTuple):
    """A row that is to be a point, and how often it is read, at the least."""

    code: str
    every_s: float


def number_in(code: str) -> int | None:
    """Return the register of a parameter whose code has it as a number; None of any other code."""
    number = _NUMBERED.fullmatch(code)
    return None if number is None else int(number[1])


@lru_cache(maxsize=4096)
def matching(profile: Profile, pattern: str) -> tuple[str, ...]:
    """Return the rows that may be points and fit a code, or a pattern with * and ?, in any case; () for none.

    A password is none.
    """
    wanted = spelt(profile, pattern)
    secret = profile.protected.password
    readable = [row.code for row in profile.parameters.values() if row.access is not Access.NONE]
    return tuple(code for code in readable if fnmatch.fnmatchcase(code, wanted) and code not in secret)


def why_no_row(profiles: Sequence[Profile], pattern: str) -> tuple[str, str]:
    """Return what is wrong with a code or pattern that fits no row of these families, and a hint."""
    for profile in profiles:
        wanted = spelt(profile, pattern)
        if wanted in profile.parameters:
            what = "is a password" if wanted in profile.protected.password else "cannot be read"
            return f"{wanted} of {profile.family} {what}", "leave it out"
    families = " or ".join(dict.fromkeys(profile.family for profile in profiles))
    known = {code for profile in profiles for code in profile.parameters}
    near = difflib.get_close_matches(pattern.strip().upper(), sorted(known), n=1)
    hint = f"did you mean {near[0]}?" if near else "the page of the family lists its rows"
    if any(raw_row(each, number_in(spelt(each, pattern)) or -1) for each in profiles):
        hint = f"describe it with a [[row]]; or {hint}"
    return f"{pattern!r} fits no row of {families}", hint


def why_not_described(profile: Profile, row: Parameter) -> str:
    """Return why a site may not describe this row of holding registers; empty where it may."""
    known = profile.parameters.get(row.code)
    if profile.protected.names(row.code):
        return "it may command the motor, cut the connection or act at once, or is a password"
    if known is not None and known.access in (Access.NONE, Access.COMMAND):
        return known.note or "it is a command"
    if known is not None and not _is_open(known):
        return "the family's manual describes it: nothing is to be added"
    if any(point.code == row.code for point in profile.points.values()):
        return "it is read as a point of the family already"
    if known is not None and (row.table, row.address, row.words) != (known.table, known.address, known.words):
        return f"the manual gives it the register {known.address}"
    if (over := _overlapped(profile, row)) is not None:
        return f"its registers are those of {over.code}"
    end = row.address + row.words - 1
    if any(first <= end and row.address <= last for first, last in profile.protected.stand_ins):
        return "its registers may be those of any other row"
    if row.access is not Access.RW:
        return ""
    if row.words > 1:
        return "it has two registers to be written, and the second may be another parameter's"
    if row.is_rated_scaled:
        return "its scale depends on the model, so that it cannot be set"
    reasons = profile.protected.site.items()
    return next((why for begins, why in reasons if row.code.startswith(begins)), "")


def _is_open(row: Parameter) -> bool:
    """Return whether the manual only names a row, or other documents do."""
    if not row.is_sure or not is_named(row.name):
        return True
    return row.access is Access.RW and row.raw_min is None and not row.is_settable_text


def _overlapped(profile: Profile, row: Parameter) -> Parameter | None:
    end = row.address + row.words
    for other in profile.parameters.values():
        is_over = other.address < end and row.address < other.address + other.words
        if other.table is row.table and is_over and other.code != row.code:
            return other
    return None


@lru_cache(maxsize=512)
def extended(profile: Profile, rows: tuple[SiteRow, ...], points: tuple[SitePoint, ...]) -> Profile:
    """Return the profile with a site's rows and points; the same one for the same additions.

    A row that is a point of the family already is no other point.
    """
    if not rows and not points:
        return profile
    parameters = {**profile.parameters, **{each.row.code: each.row for each in rows}}
    names = {each.row.code: each.point for each in rows}
    added: dict[str, Point] = {}
    for each in points:
        if point_of(profile, parameters[each.code]) is None:
            name = names.get(each.code) or to_level(each.code)
            added[name] = Point(code=each.code, group=EXTRA, every_s=each.every_s)
    return remade(profile, parameters=parameters, points={**profile.points, **added})
