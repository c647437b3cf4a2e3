"""Rules across the tables of a configuration.

The rules look at the document as parsed, before the models: a mistake in one table must not hide those in
others. A value of the wrong type is the models' business and passes here.
"""

from __future__ import annotations

import fnmatch
import os
import posixpath
import re
from collections.abc import Iterator, Mapping
from typing import get_args

from gateway.config.mistakes import (
    Document,
    Mistake,
    again,
    choose,
    lines_in,
    list_in,
    short,
    starters_in,
    starters_of,
    table_in,
    text_in,
)
from gateway.config.network_checks import network_mistakes
from gateway.config.schema import Baud, FramingText
from gateway.config.site_checks import site_mistakes
from gateway.config.toml_lines import Key
from gateway.contract import CommandError
from gateway.families import FAMILIES, Profile, load_profile, parameters

_SOCKET = re.compile(r"socket://[^\s:/]+:(\d{1,5})")


def broken_rules(document: Document) -> list[Mistake]:
    """Return every mistake that no single value shows."""
    return [
        *network_mistakes(document),
        *_ports(document),
        *_duplicates(document),
        *_orders(document),
        *_families(document),
        *_patterns(document),
        *_groups(document),
        *_feeders(document),
        *_simulated(document),
        *site_mistakes(document),
    ]


def _ports(document: Document) -> Iterator[Mistake]:
    for key, line in lines_in(document):
        port = text_in(line, "port")
        if not port or posixpath.isabs(port):
            continue
        socket = _SOCKET.fullmatch(port)
        if socket is None or not 0 < int(socket[1]) <= 0xFFFF:
            hint = "an absolute path such as /dev/serial/by-id/..., or socket://host:port"
            yield Mistake((*key, "port"), f"{short(port)} is no port", hint)


def _duplicates(document: Document) -> Iterator[Mistake]:
    lines: dict[object, Key] = {}
    ports: dict[object, Key] = {}
    starters: dict[object, Key] = {}
    for key, line in lines_in(document):
        addresses: dict[object, Key] = {}
        yield from again(lines, (*key, "name"), text_in(line, "name"), "each line needs its own name")
        port, hint = text_in(line, "port"), "put all starters of a port under one [[line]]"
        yield from again(ports, (*key, "port"), port, hint, by=_adapter(port))
        for starter_key, starter in starters_of(key, line):
            hint = "each starter needs its own name, whatever its line"
            yield from again(starters, (*starter_key, "name"), text_in(starter, "name"), hint)
            hint = "each starter on a line needs its own address"
            yield from again(addresses, (*starter_key, "address"), starter.get("address"), hint)


def _adapter(port: str) -> object:
    """Return what all names of an adapter have in common: its device number, while it is plugged in."""
    if not posixpath.isabs(port):
        return port
    try:
        number = os.stat(port).st_rdev
    except (OSError, ValueError):
        number = 0
    return number or posixpath.normpath(port)


def _orders(document: Document) -> Iterator[Mistake]:
    """Yield what an order along the cable names that is not on the line, names twice or leaves out."""
    for key, line in lines_in(document):
        if not isinstance(line.get("order"), list):
            continue
        names = [name for _, starter in starters_of(key, line) if (name := text_in(starter, "name"))]
        order, where = list_in(line, "order"), (*key, "order")
        for position, name in enumerate(order):
            if isinstance(name, str) and name not in names:
                yield Mistake((*where, position), f"{short(name)} is not on this line", choose(name, names))
            elif isinstance(name, str) and name in order[:position]:
                yield Mistake((*where, position), f"{short(name)} stands twice", "name each starter once")
        missing = [name for name in names if name not in order]
        if missing and all(name in names for name in order):
            text = f"leaves out {short(missing[0])}"
            yield Mistake(where, text, "name all starters of the line as the cable passes them")


def _families(document: Document) -> Iterator[Mistake]:
    for key, line in lines_in(document):
        by_family = {s["family"]: text_in(s, "name") for _, s in starters_of(key, line) if _is_family(s)}
        for family, name in by_family.items():
            yield from _serial(key, line, load_profile(family), name)
        for starter_key, starter in starters_of(key, line):
            profile = load_profile(starter["family"]) if _is_family(starter) else None
            if profile and "slot" in starter and len(profile.command_word) < 2:
                yield Mistake((*starter_key, "slot"), f"{profile.family} has no slots", "leave it out")


def _is_family(starter: Document) -> bool:
    return text_in(starter, "family") in FAMILIES


def _serial(key: Key, line: Document, profile: Profile, name: str) -> Iterator[Mistake]:
    """Yield what a family's serial interface cannot be set to; `name` is a starter of it on this line."""
    baud, framing = line.get("baud"), line.get("framing")
    if baud in get_args(Baud) and profile.bauds and baud not in profile.bauds:
        hint = f"its manual allows {', '.join(map(str, profile.bauds))}"
        yield Mistake((*key, "baud"), f"{baud} is not for {profile.family} ({name})", hint)
    if framing in get_args(FramingText) and framing not in profile.framings:
        hint = f"its manual allows {', '.join(profile.framings)}"
        what = f"{short(framing)} is not for {profile.family} ({name})"
        yield Mistake((*key, "framing"), what, hint)


def _patterns(document: Document) -> Iterator[Mistake]:
    names = [name for _, starter in starters_in(document) if (name := text_in(starter, "name"))]
    for where in ("operator", "rules", "group", "points"):
        for index, table in enumerate(list_in(document, where)):
            patterns = list_in(table, "starters") if isinstance(table, Mapping) else []
            for position, pattern in enumerate(patterns):
                if isinstance(pattern, str) and not fnmatch.filter(names, pattern):
                    hint = choose(pattern, names) if names else ""
                    key = (where, index, "starters", position)
                    yield Mistake(key, f"{short(pattern)} fits no starter", hint)


def _groups(document: Document) -> Iterator[Mistake]:
    """Yield groups whose name is used twice: a command's topic must name one target."""
    seen: dict[object, Key] = {}
    for starter_key, starter in starters_in(document):
        seen.setdefault(text_in(starter, "name"), (*starter_key, "name"))
    for index, group in enumerate(list_in(document, "group")):
        if isinstance(group, Mapping):
            hint = "each group needs a name that no starter and no other group has"
            yield from again(seen, ("group", index, "name"), text_in(group, "name"), hint)


def _feeders(document: Document) -> Iterator[Mistake]:
    """Yield starters for which a feeder is named without a time, or a time without a feeder."""
    shared = [table for table in list_in(document, "rules") if isinstance(table, Mapping)]
    for starter_key, starter in starters_in(document):
        name = text_in(starter, "name")
        tables = [t for t in shared if any(_fits(name, p) for p in list_in(t, "starters"))]
        own = {named for table in (*tables, table_in(starter, "rules")) for named in table}
        for one, other in (("feeder", "stagger_s"), ("stagger_s", "feeder")):
            if one in own and other not in own:
                hint = "a feeder and the time between two starts on it go together"
                yield Mistake((*starter_key, "name"), f"{short(name)} has {one} without {other}", hint)


def _simulated(document: Document) -> Iterator[Mistake]:
    """Yield what a simulated starter of its family does not have."""
    for starter_key, starter in starters_in(document):
        if not _is_family(starter):
            continue
        profile = load_profile(starter["family"])
        table = table_in(starter, "simulated")
        for code in table_in(table, "parameters"):
            row = profile.parameters.get(code)
            if row is None or row.table.is_bits or row.words != 1:
                hint = "name a parameter of one register by its code in the manual, such as P314 or C8.2.5.3"
                where = (*starter_key, "simulated", "parameters", code)
                yield Mistake(where, f"{profile.family} has no such parameter", hint)
        if "markers" in table and "markers" not in profile.simulated:
            yield Mistake((*starter_key, "simulated", "markers"), _is_for("markers"), "leave it out")
        for code in table_in(table, "markers") if "markers" in profile.simulated else ():
            if not _is_marker(profile, code):
                where = (*starter_key, "simulated", "markers", code)
                hint = "write COIL or DI and its address, such as DI7"
                yield Mistake(where, f"{profile.family} has no such marker", hint)
        rows = profile.simulated.get("braking_s")
        if table.get("braking_s") and rows != ():
            hint = f"set {' and '.join(rows)} as parameters" if rows else "leave it out"
            yield Mistake((*starter_key, "simulated", "braking_s"), _is_for("braking_s"), hint)


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
