"""What is wrong with the points and rows that a site adds: codes that no row has, rows that may not be."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from pydantic import ValidationError

from gateway.config.mistakes import Document, Mistake, again, lines_in, list_in, starters_of, text_in
from gateway.config.site_tables import SCALES, RowTable, rows_of
from gateway.config.toml_lines import Key
from gateway.contract import to_level
from gateway.families import FAMILIES, TYPE_LIMITS, Profile, Type, extension, load_profile


def site_mistakes(document: Document) -> Iterator[Mistake]:
    """Yield every mistake in what a site adds that no single value shows."""
    tables = [
        (("row", index), row)
        for index, table in enumerate(list_in(document, "row"))
        if (row := _row_in(table)) is not None
    ]
    yield from _rows(tables)
    added = [row for _, row in tables]
    profiles = {
        family: extension.extended(load_profile(family), rows_of(family, added), ()) for family in FAMILIES
    }
    for key, line in lines_in(document):
        families = [(at, profiles.get(text_in(each, "family")), each) for at, each in starters_of(key, line)]
        known = [profile for _, profile, _ in families if profile is not None]
        yield from _codes((*key, "points"), list_in(line, "points"), known)
        for at, profile, starter in families:
            yield from _codes((*at, "points"), list_in(starter, "points"), [profile] if profile else [])
    for index, table in enumerate(list_in(document, "points")):
        if isinstance(table, Mapping) and text_in(table, "family") in profiles:
            profile = profiles[table["family"]]
            yield from _codes(("points", index, "codes"), list_in(table, "codes"), [profile])


def _codes(key: Key, patterns: Sequence[Any], profiles: Sequence[Profile]) -> Iterator[Mistake]:
    """Yield codes and patterns that fit no readable row of any of these families."""
    for position, pattern in enumerate(patterns):
        if not isinstance(pattern, str) or not profiles:
            continue
        if not any(extension.matching(profile, pattern) for profile in profiles):
            yield Mistake((*key, position), *extension.why_no_row(profiles, pattern))


def _row_in(table: Any) -> RowTable | None:
    """Return a table of a row; None where one of its values is wrong by itself."""
    try:
        return RowTable.model_validate(table)
    except ValidationError:
        return None


def _rows(tables: Sequence[tuple[Key, RowTable]]) -> Iterator[Mistake]:
    codes: dict[object, Key] = {}
    names: dict[object, Key] = {}
    for key, row in tables:
        wrong = _wrong_in(row)
        if wrong is not None:
            name, what, hint = wrong
            yield Mistake((*key, name), what, hint)
        by = (row.family, row.parameter)
        yield from again(codes, (*key, "parameter"), row.parameter, "describe each row once", by=by)
        by = (row.family, row.name)
        yield from again(names, (*key, "name"), row.name, "each row needs its own name", by=by)


def _wrong_in(row: RowTable) -> tuple[str, str, str] | None:
    """Return what contradicts something else in a row, or in its family: the key, what, and the hint."""
    profile = row.profile
    if not profile.protected.site:
        return "family", f"the manual of {row.family} describes all its rows", "leave this [[row]] out"
    if row.place is None and profile.raw_range is None:
        return "parameter", "needs address beside it", "its register, as that manual prints it"
    if row.place is None:
        hint = "P and three digits, such as P102"
        return "parameter", f"{row.parameter!r} is no parameter of {row.family}", hint
    if row.address is not None and row.address != row.place:
        return "address", f"is {row.address}, and not the number of {row.parameter}", "leave it out"
    if row.scale not in SCALES:
        return "scale", f"is {row.scale:g}", f"one of {', '.join(f'{each:g}' for each in SCALES)}"
    if row.limits is None and (row.writable or row.min is not None or row.max is not None):
        missing = "min" if row.min is None else "max"
        return ("writable" if row.writable else "parameter"), f"needs {missing} beside it", "both limits"
    if row.limits is not None:
        low, high = row.limits
        lowest, highest = TYPE_LIMITS[Type(row.type)]
        if not lowest <= low <= high <= highest:
            return "max", f"{row.min:g} to {row.max:g} do not fit {row.type}", "another type, or other limits"
    why = extension.why_not_described(profile, row.described().row)
    if why:
        return "parameter", f"{row.parameter} is not to be described: {why}", "leave this [[row]] out"
    taken = {*profile.points, *(to_level(code) for code in profile.parameters)} - {to_level(row.parameter)}
    if row.name in taken:
        return "name", f"{row.name!r} is a name of {row.family} already", "another name"
    return None
