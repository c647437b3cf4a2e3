"""Rules across tables: names that must differ, names that must exist, and what needs the whole site.

Names are looked up in the document as it is written, so that a mistake in one table hides none in others; the
rest is judged of the document without the keys that are wrong by themselves.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from fnmatch import filter as fitting
from typing import Any

from gateway.config.integration_tables import DEFAULT_DISCOVERY_PREFIX, HomeAssistantTable
from gateway.config.mistakes import Key, Mistake, choose, short, spell
from gateway.config.schema import Config, StarterTable
from gateway.config.site_tables import PointsTable, rows_of
from gateway.config.values import GLOB_PATTERN
from gateway.families import Profile, extension, load_profile
from gateway.starters import OWN_POINT_NAMES

SPARKPLUG_NAMESPACE = "spBv1.0"

Document = Mapping[str, Any]


# Keys of which no two may be alike, and why. A command's topic must name one target: a starter or a group.
_UNIQUE = {
    ("line.name",): "each line needs its own name",
    ("line.port",): "put all starters of a port under one [[line]]",
    ("line.starter.name", "group.name"): "each starter needs its own name, and so does each group",
    ("line.starter.address",): "each starter on a line needs its own address",
    ("web.user.name",): "each login needs its own name",
}


def wrong_names(document: Document) -> Iterator[Mistake]:
    """Yield names that stand twice, and names of what is not there."""
    for paths, hint in _UNIQUE.items():
        seen: dict[object, Key] = {}
        for key, value in (found for path in paths for found in _at(document, path)):
            compared = (key[1], value) if key[-1] == "address" else value  # those of one line
            yield from _again(seen, key, value, compared, hint)
    names = [str(name) for _, name in _at(document, "line.starter.name")]
    for table in ("operator", "rules", "group", "points"):
        for key, pattern in _at(document, f"{table}.starters"):
            is_pattern = isinstance(pattern, str) and re.fullmatch(GLOB_PATTERN[1:-1], pattern)
            if is_pattern and not fitting(names, str(pattern)):
                yield Mistake(
                    key, f"{short(pattern)} fits no starter", choose(pattern, names) if names else ""
                )
    clients = [str(client) for _, client in _at(document, "operator.client")]
    for table in ("web.user", "homeassistant", "sparkplug"):
        for key, client in _at(document, f"{table}.operator"):
            if client not in clients:
                hint = choose(client, clients) if clients else "add an [[operator]] with this client"
                yield Mistake(key, f"{short(client)} is no [[operator]]'s client", hint)


def broken_rules(config: Config) -> Iterator[Mistake]:
    """Yield every mistake that no single table shows."""
    key: Key
    for at, line in enumerate(config.lines):
        families = dict.fromkeys(each.family for each in line.starters)
        yield from _codes(("line", at, "points"), line.points, config, families)
        for place, starter in enumerate(line.starters):
            key = ("line", at, "starter", place)
            yield from _feeder(key, starter, config)
            yield from _codes((*key, "points"), starter.points, config, [starter.family])
    for at, points in enumerate(config.points):
        yield from _codes(("points", at, "codes"), points.codes, config, [points.family])
        yield from _of_other_families(("points", at, "starters"), points, config)
    codes: dict[object, Key] = {}
    names: dict[object, Key] = {}
    for at, row in enumerate(config.rows):
        key, code, name = ("row", at), row.parameter, row.name
        yield from _again(codes, (*key, "parameter"), code, (row.family, code), "describe each row once")
        yield from _again(names, (*key, "name"), name, (row.family, name), "each row needs its own name")
    yield from _traced(config)
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


def _again(
    seen: dict[object, Key], key: Key, value: object, compared: object, hint: str
) -> Iterator[Mistake]:
    """Yield a value that another key has too; `seen` is what came before. Only texts and numbers are."""
    if type(value) not in (str, int):
        return
    if compared in seen:
        yield Mistake(key, f"{short(value)} is also {spell(seen[compared])}", hint)
    seen.setdefault(compared, key)


def _codes(key: Key, patterns: Sequence[str], config: Config, families: Iterable[str]) -> Iterator[Mistake]:
    """Yield codes and patterns that fit no readable row of any of these families."""
    profiles = [_profile(family, config) for family in families] if patterns else []
    for position, pattern in enumerate(patterns):
        if not any(extension.matching(profile, pattern) for profile in profiles):
            yield Mistake((*key, position), *extension.why_no_row(profiles, pattern))


def _of_other_families(key: Key, points: PointsTable, config: Config) -> Iterator[Mistake]:
    """Yield names and patterns of starters of which none is of the family, so that they ask for nothing."""
    for position, pattern in enumerate(points.starters if "starters" in points.model_fields_set else ()):
        found = {starter.family for starter in config.starters if starter.is_among([pattern])}
        if points.family not in found:
            what = f"{short(pattern)} fits no {points.family}"
            yield Mistake((*key, position), what, f"such starters are of {' and '.join(sorted(found))}")


def _profile(family: str, config: Config) -> Profile:
    return extension.extended(load_profile(family), rows_of(family, config.rows), ())


def _traced(config: Config) -> Iterator[Mistake]:
    """Yield points whose values are to be stored and that no starter has."""
    points = OWN_POINT_NAMES.union(*(starter.profile().points for starter in config.starters))
    for position, name in enumerate(config.traced):
        if name not in points:
            hint = choose(name, sorted(points), otherwise="the topics B/starter/+/info list all points")
            yield Mistake(("history", "values", position), f"{short(name)} is a point of no starter", hint)


def _feeder(key: Key, starter: StarterTable, config: Config) -> Iterator[Mistake]:
    """Yield a feeder that is named without a time, or a time without a feeder."""
    given = set(starter.rules.model_fields_set if starter.rules else ())
    for rules in config.rules:
        if starter.is_among(rules.starters):
            given |= rules.model_fields_set
    for one, other in (("feeder", "stagger_s"), ("stagger_s", "feeder")):
        if one in given and other not in given:
            hint = "a feeder and the time between two starts on it go together"
            yield Mistake((*key, "name"), f"{short(starter.name)} has {one} without {other}", hint)


def _home_assistant(table: HomeAssistantTable, base: str) -> Iterator[Mistake]:
    """Yield topics that are the gateway's own, Sparkplug's or discovery's."""
    prefix = table.discovery_prefix
    if "discovery_prefix" not in table.model_fields_set and _is_one_in_the_other(base, prefix):
        hint = f"another base, or discovery_prefix, which is {short(DEFAULT_DISCOVERY_PREFIX)} by itself"
        yield Mistake(("mqtt", "base"), "lies among the topics of Home Assistant's discovery", hint)
    for key in table.model_fields_set & {"discovery_prefix", "birth_topic"}:
        topic, where = getattr(table, key), ("homeassistant", key)
        for others, whose in ((base, "the gateway's own"), (SPARKPLUG_NAMESPACE, "Sparkplug's")):
            if _is_one_in_the_other(topic, others):
                yield Mistake(where, f"lies among {whose} topics", f"a topic outside {short(others)}")
    devices = f"{prefix}/device"
    if _is_one_in_the_other(table.birth_topic or "", devices):
        hint = f"a topic outside {short(devices)}, such as {prefix}/status"
        yield Mistake(("homeassistant", "birth_topic"), "lies among the topics of discovery", hint)


def _is_one_in_the_other(one: str, other: str) -> bool:
    """Return whether a topic is the other one, or one of its levels; False when there is none."""
    one, other = f"{one}/", f"{other}/"
    return one != "/" and (one.startswith(other) or other.startswith(one))
