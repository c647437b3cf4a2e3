"""Rules across tables: names that must differ, names and codes that must exist, rules of the whole site.

What people name or ask for is judged in the document as it is written, so that a mistake in one table hides
none in others (`wrong_across`); the rest is judged of a configuration that has no other mistakes.
"""

from __future__ import annotations

import posixpath
from collections.abc import Iterator, Mapping
from fnmatch import fnmatchcase
from itertools import chain
from typing import Any

from pydantic import ValidationError

from gateway.config.convert import policy_of
from gateway.config.integration_tables import HomeAssistantTable
from gateway.config.mistakes import Key, Mistake, choose, short, spell
from gateway.config.schema import Config
from gateway.config.site_tables import RowTable, rows_of
from gateway.families import FAMILIES, extension, load_profile
from gateway.starters import OWN_POINT_NAMES

SPARKPLUG_NAMESPACE = "spBv1.0"

Document = Mapping[str, Any]
_Families = Mapping[Key, str | None]  # by the keys of tables; None: not known

# Keys of which no two may be alike, and why. A command's topic must name one target: a starter or a group.
_UNIQUE = {
    ("line.name",): "each line needs its own name",
    ("line.port",): "put all starters of a port under one [[line]]",
    ("line.starter.name", "group.name"): "each starter needs its own name, and so does each group",
    ("line.starter.address",): "each starter on a line needs its own address",
    ("web.user.name",): "each login needs its own name",
    ("row.parameter",): "describe each row once",
    ("row.name",): "each row needs its own name",
}


def wrong_across(document: Document) -> Iterator[Mistake]:
    """Yield values that must differ, and names, codes and feeders without their counterpart."""
    tables = dict(chain(*(_at(document, path) for path in ("line.starter", "points", "row"))))
    found = {key: table.get("family") for key, table in tables.items() if isinstance(table, dict)}
    families = {key: family if family in FAMILIES else None for key, family in found.items()}
    starters = {key[:-1]: str(name) for key, name in _at(document, "line.starter.name")}
    yield from _alike(document, families)
    for table in ("operator", "rules", "group", "points"):
        for key, pattern in _at(document, f"{table}.starters"):
            yield from _unfitting(key, str(pattern), starters, families)
    clients = [str(client) for _, client in _at(document, "operator.client")]
    for table in ("web.user", "homeassistant", "sparkplug"):
        for key, client in _at(document, f"{table}.operator"):
            if client not in clients:
                hint = choose(client, clients) if clients else "add an [[operator]] with this client"
                yield Mistake(key, f"{short(client)} is no [[operator]]'s client", hint)
    yield from _wrong_codes(document, families)


def broken_rules(config: Config) -> Iterator[Mistake]:
    """Yield every mistake that the whole site shows."""
    yield from _traced(config)
    yield from _half_feeders(config)
    if config.home_assistant is not None:
        yield from _home_assistant(config.home_assistant, config.base)
    if config.metrics is not None and config.metrics.textfile is None and config.web is None:
        hint = "add a [web] table, whose server answers /metrics, or a textfile for node-exporter"
        yield Mistake(("metrics",), "nothing serves them", hint)


def _at(document: Any, path: str, key: Key = ()) -> Iterator[tuple[Key, object]]:
    """Yield the values at a path, in all tables and items of the lists on it, with their keys."""
    name, _, rest = path.partition(".")
    if isinstance(document, list):
        for place, item in enumerate(document):
            yield from _at(item, path, (*key, place))
    elif not path:
        yield key, document
    elif isinstance(document, dict) and name in document:
        yield from _at(document[name], rest, (*key, name))


def _alike(document: Document, families: _Families) -> Iterator[Mistake]:
    """Yield values that another key has too: of addresses on the same line, of rows in the same family."""
    for paths, hint in _UNIQUE.items():
        seen: dict[object, Key] = {}
        for key, value in chain(*(_at(document, path) for path in paths)):
            if type(value) not in (str, int):
                continue
            scope = key[1] if key[-1] == "address" else families.get(key[:2])
            compared = scope, posixpath.normpath(str(value)) if key[-1] == "port" else value
            if compared in seen:
                yield Mistake(key, f"{short(value)} is also {spell(seen[compared])}", hint)
            seen.setdefault(compared, key)


def _unfitting(key: Key, pattern: str, starters: Mapping[Key, str], families: _Families) -> Iterator[Mistake]:
    """Yield a pattern that fits no starter; of [[points]] also one that fits none of their family."""
    fitting = [at for at, name in starters.items() if fnmatchcase(name, pattern)]
    found, wanted = {families.get(at) for at in fitting}, families.get(key[:2])
    if not fitting:
        hint = choose(pattern, starters.values()) if starters else ""
        yield Mistake(key, f"{short(pattern)} fits no starter", hint)
    elif wanted is not None and not found & {wanted, None}:
        hint = f"such starters are of {' and '.join(sorted(map(str, found)))}"
        yield Mistake(key, f"{short(pattern)} fits no {wanted}", hint)


def _wrong_codes(document: Document, families: _Families) -> Iterator[Mistake]:
    """Yield codes and patterns that fit no readable row of the families of their table.

    Nothing is said where a family or a row is wrong that may have them.
    """
    try:
        rows = [RowTable.model_validate(table) for _, table in _at(document, "row")]
    except ValidationError:
        return
    for path in ("line.points", "line.starter.points", "points.codes"):
        for key, code in _at(document, path):
            table = key[:-2]
            of_line = (family for at, family in families.items() if at[: len(table)] == table)
            own = [families[table]] if table in families else list(dict.fromkeys(of_line))
            if not own or None in own or not isinstance(key[-1], int):
                continue
            profiles = [
                extension.extended(load_profile(str(each)), rows_of(str(each), rows), ()) for each in own
            ]
            if not any(extension.matching(profile, str(code)) for profile in profiles):
                yield Mistake(key, *extension.why_no_row(profiles, str(code)))


def _half_feeders(config: Config) -> Iterator[Mistake]:
    """Yield starters with a feeder that is named without a time, or a time without a feeder."""
    rules = policy_of(config).rules
    for at, line in enumerate(config.lines):
        for place, starter in enumerate(line.starters):
            if bool(rules[starter.name].feeder) != bool(rules[starter.name].stagger_s):
                key, what = ("line", at, "starter", place, "name"), "has only one of feeder and stagger_s"
                yield Mistake(key, what, "a feeder and the time between two starts on it go together")


def _traced(config: Config) -> Iterator[Mistake]:
    """Yield points whose values are to be stored and that no starter has."""
    points = OWN_POINT_NAMES.union(*(starter.profile().points for starter in config.starters))
    for position, name in enumerate(config.traced):
        if name not in points:
            hint = choose(name, sorted(points), otherwise="the topics B/starter/+/info list all points")
            yield Mistake(("history", "values", position), f"{short(name)} is a point of no starter", hint)


def _home_assistant(table: HomeAssistantTable, base: str) -> Iterator[Mistake]:
    """Yield topics that are the gateway's own, Sparkplug's or discovery's."""
    own, spark = (base, "the gateway's own"), (SPARKPLUG_NAMESPACE, "Sparkplug's")
    devices = f"{table.discovery_prefix}/device", "discovery's"
    for key, foreign in (("discovery_prefix", (own, spark)), ("birth_topic", (own, spark, devices))):
        for others, whose in foreign:
            if _is_one_in_the_other(getattr(table, key) or "", others):
                hint = f"a topic outside {short(others)}"
                yield Mistake(("homeassistant", key), f"lies among {whose} topics", hint)


def _is_one_in_the_other(one: str, other: str) -> bool:
    """Return whether a topic is the other one, or one of its levels; False when there is none."""
    one, other = f"{one}/", f"{other}/"
    return one != "/" and (one.startswith(other) or other.startswith(one))
