"""What is wrong with the points and rows that a site adds: codes that no row has, rows that may not be."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from decimal import Decimal

from gateway.config.mistakes import Mistake, Tables, again
from gateway.config.schema import LineTable, StarterTable
from gateway.config.site_tables import SCALES, PointsTable, RowTable, rows_of
from gateway.config.toml_lines import Key
from gateway.contract import to_level
from gateway.families import FAMILIES, TYPE_LIMITS, Profile, Type, extension, load_profile
from gateway.starters import OWN_POINT_NAMES

REGISTERS = 65536

# What records and other programs name, beside points.
_TAKEN = {"state", "quality", "availability", "reason", "locked", "online", "trouble", "result"}
_TAKEN |= {"start", "stop", "reset", "thermal_load"}


def site_mistakes(tables: Tables) -> Iterator[Mistake]:
    """Yield every mistake in what a site adds that no single value shows."""
    rows = [(key, table) for key, table in tables.items() if isinstance(table, RowTable)]
    yield from _rows(rows)
    profiles = {
        family: extension.extended(load_profile(family), rows_of(family, [row for _, row in rows]), ())
        for family in FAMILIES
    }
    for key, table in tables.items():
        match table:
            case LineTable():
                families = dict.fromkeys(each.family for each in table.starters)
                yield from _codes((*key, "points"), table.points, [profiles[each] for each in families])
            case StarterTable():
                yield from _codes((*key, "points"), table.points, [profiles[table.family]])
            case PointsTable():
                yield from _codes((*key, "codes"), table.codes, [profiles[table.family]])


def _codes(key: Key, patterns: Sequence[str], profiles: Sequence[Profile]) -> Iterator[Mistake]:
    """Yield codes and patterns that fit no readable row of any of these families."""
    for position, pattern in enumerate(patterns):
        if not any(extension.matching(profile, pattern) for profile in profiles):
            yield Mistake((*key, position), *extension.why_no_row(profiles, pattern))


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
    if row.place + (2 if row.type.endswith("32") else 1) > REGISTERS:
        return "address", f"{row.place} and the next are no registers", "the last register is 65535"
    if row.scale not in SCALES:
        return "scale", f"is {row.scale:g}", f"one of {', '.join(f'{each:g}' for each in SCALES)}"
    if row.limits is None and (row.writable or row.min is not None or row.max is not None):
        missing = "min" if row.min is None else "max"
        return ("writable" if row.writable else "parameter"), f"needs {missing} beside it", "both limits"
    for name, limit in (("min", row.min), ("max", row.max)):
        if limit is not None and Decimal(str(limit)) % Decimal(str(row.scale)):
            return name, f"{limit:g} is no multiple of scale", f"the row has steps of {row.scale:g}"
    if row.limits is not None:
        low, high = row.limits
        lowest, highest = TYPE_LIMITS[Type(row.type)]
        if not lowest <= low <= high <= highest:
            return "max", f"{row.min:g} to {row.max:g} do not fit {row.type}", "another type, or other limits"
    why = extension.why_not_described(profile, row.described().row)
    if why:
        return "parameter", f"{row.parameter} is not to be described: {why}", "leave this [[row]] out"
    codes = {to_level(code) for code in profile.parameters} - {to_level(row.parameter)}
    points = {name for family in FAMILIES for name in load_profile(family).points}  # rules go by their names
    if row.name in codes | points | OWN_POINT_NAMES | _TAKEN:
        return "name", f"{row.name!r} means something else already", "another name"
    return None
