"""Rules that no single value shows: between the keys of a table, and across tables.

They look at the tables that are right by themselves: a mistake in one must not hide those in others. Names
that others refer to are looked up in the whole document, so that a wrong table is not missing besides.
"""

from __future__ import annotations

import fnmatch
import os
import posixpath
from collections.abc import Iterator
from typing import TypeVar

from gateway.config.mistakes import Document, Mistake, Tables, again, choose, texts_in
from gateway.config.network_checks import network_mistakes
from gateway.config.schema import GroupTable, LineTable, OperatorTable, SharedRulesTable, StarterTable
from gateway.config.site_checks import site_mistakes
from gateway.config.site_tables import PointsTable
from gateway.config.toml_lines import Key
from gateway.config.values import ConfigTable, short
from gateway.contract import CommandError
from gateway.families import FAMILIES, Profile, diagnosis, load_profile, parameters

_Table = TypeVar("_Table", bound=ConfigTable)


def broken_rules(document: Document, tables: Tables) -> Iterator[Mistake]:
    """Yield every mistake that no single value shows."""
    yield from network_mistakes(document, tables)
    yield from _duplicates(tables)
    names = texts_in(document, "line", "starter", "name")
    for key, table in tables.items():
        match table:
            case LineTable():
                yield from _order(key, table)
                yield from _serial(key, table)
            case StarterTable():
                yield from _feeder(key, table, tables)
                yield from _of_family(key, table, load_profile(table.family))
            case OperatorTable() | SharedRulesTable() | GroupTable() | PointsTable():
                for position, pattern in enumerate(table.starters):
                    if not fnmatch.filter(names, pattern):
                        hint = choose(pattern, names) if names else ""
                        where = (*key, "starters", position)
                        yield Mistake(where, f"{short(pattern)} fits no starter", hint)
    yield from site_mistakes(tables)


def _of(tables: Tables, kind: type[_Table]) -> list[tuple[Key, _Table]]:
    return [(key, table) for key, table in tables.items() if isinstance(table, kind)]


def _duplicates(tables: Tables) -> Iterator[Mistake]:
    lines: dict[object, Key] = {}
    ports: dict[object, Key] = {}
    names: dict[object, Key] = {}  # of starters and groups: a command's topic must name one target
    addresses: dict[object, Key] = {}
    for key, line in _of(tables, LineTable):
        yield from again(lines, (*key, "name"), line.name, "each line needs its own name")
        hint = "put all starters of a port under one [[line]]"
        yield from again(ports, (*key, "port"), line.port, hint, by=_adapter(line.port))
    for key, starter in _of(tables, StarterTable):
        hint = "each starter needs its own name, whatever its line"
        yield from again(names, (*key, "name"), starter.name, hint)
        hint, by = "each starter on a line needs its own address", (key[1], starter.address)
        yield from again(addresses, (*key, "address"), starter.address, hint, by=by)
    for key, group in _of(tables, GroupTable):
        hint = "each group needs a name that no starter and no other group has"
        yield from again(names, (*key, "name"), group.name, hint)


def _adapter(port: str) -> object:
    """Return what all names of an adapter have in common: its device number, while it is plugged in."""
    if not posixpath.isabs(port):
        return port
    try:
        number = os.stat(port).st_rdev
    except (OSError, ValueError):
        number = 0
    return number or posixpath.normpath(port)


def _order(key: Key, line: LineTable) -> Iterator[Mistake]:
    """Yield what an order along the cable names that is not on the line, names twice or leaves out."""
    names, order, where = [each.name for each in line.starters], line.order, (*key, "order")
    for position, name in enumerate(order or ()):
        if name not in names:
            yield Mistake((*where, position), f"{short(name)} is not on this line", choose(name, names))
        elif order and name in order[:position]:
            yield Mistake((*where, position), f"{short(name)} stands twice", "name each starter once")
    missing = [] if order is None else [name for name in names if name not in order]
    if missing and all(name in names for name in order or ()):
        hint = "name all starters of the line as the cable passes them"
        yield Mistake(where, f"leaves out {short(missing[0])}", hint)


def _serial(key: Key, line: LineTable) -> Iterator[Mistake]:
    """Yield what a family's serial interface cannot be set to, with a starter of it on this line."""
    for family, name in {each.family: each.name for each in line.starters}.items():
        profile = load_profile(family)
        for setting, value, allowed in (
            ("baud", line.baud, profile.bauds or (line.baud,)),
            ("framing", line.framing, profile.framings),
        ):
            if value not in allowed:
                shown = value if setting == "baud" else short(value)
                hint = f"its manual allows {', '.join(map(str, allowed))}"
                yield Mistake((*key, setting), f"{shown} is not for {family} ({name})", hint)


def _feeder(key: Key, starter: StarterTable, tables: Tables) -> Iterator[Mistake]:
    """Yield a feeder that is named without a time, or a time without a feeder."""
    given = set(starter.rules.model_fields_set if starter.rules else ())
    for _, rules in _of(tables, SharedRulesTable):
        if any(fnmatch.fnmatchcase(starter.name, pattern) for pattern in rules.starters):
            given |= rules.model_fields_set
    for one, other in (("feeder", "stagger_s"), ("stagger_s", "feeder")):
        if one in given and other not in given:
            hint = "a feeder and the time between two starts on it go together"
            yield Mistake((*key, "name"), f"{short(starter.name)} has {one} without {other}", hint)


def _of_family(key: Key, starter: StarterTable, profile: Profile) -> Iterator[Mistake]:
    """Yield what a starter of its family, or a simulated one, does not have."""
    if starter.slot is not None and len(profile.command_word) < 2:
        yield Mistake((*key, "slot"), f"{profile.family} has no slots", "leave it out")
    said = {"model": starter.model, "watchdog_s": starter.watchdog_s}
    for name, why in diagnosis.wrong_settings(profile, **said):
        yield Mistake((*key, name), f"{short(said[name])} {why}", "see its manual")
    table, where = starter.simulated, (*key, "simulated")
    for code in table.parameters:
        row = profile.parameters.get(code)
        if row is None or row.table.is_bits or row.words != 1:
            hint = "name a parameter of one register by its code in the manual, such as P314 or C8.2.5.3"
            yield Mistake((*where, "parameters", code), f"{profile.family} has no such parameter", hint)
    has_markers = "markers" in profile.simulated
    if "markers" in table.model_fields_set and not has_markers:
        yield Mistake((*where, "markers"), _is_for("markers"), "leave it out")
    for code in table.markers if has_markers else ():
        if not _is_marker(profile, code):
            hint = "write COIL or DI and its address, such as DI7"
            yield Mistake((*where, "markers", code), f"{profile.family} has no such marker", hint)
    rows = profile.simulated.get("braking_s")
    if table.braking_s and rows != ():
        hint = f"set {' and '.join(rows)} as parameters" if rows else "leave it out"
        yield Mistake((*where, "braking_s"), _is_for("braking_s"), hint)


def _is_for(option: str) -> str:
    known = (each for each in FAMILIES if load_profile(each).simulated.get(option) == ())
    return f"is for {' and '.join(known)}"


def _is_marker(profile: Profile, code: str) -> bool:
    try:
        return parameters.find(profile, code).table.is_bits
    except CommandError:
        return False


def _fits(name: str, pattern: object) -> bool:
    return isinstance(pattern, str) and fnmatch.fnmatchcase(name, pattern)
