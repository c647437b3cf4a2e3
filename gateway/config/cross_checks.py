"""Rules across tables: names that must differ, names and codes that must exist, rules of the whole site.

A rule reads a configuration from which wrong values are taken out. It is judged wherever it reads none of
them (`WHERE_RIGHT`): a mistake in one table hides none in another, and draws none after it.
"""

from __future__ import annotations

import posixpath
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from itertools import product
from types import UnionType
from typing import Any

from gateway.config.convert import rules_of
from gateway.config.integration_tables import (
    HistoryTable,
    HomeAssistantTable,
    MetricsTable,
    SparkplugTable,
    WebUserTable,
)
from gateway.config.mistakes import WHERE_RIGHT, Mistake, WrongValueError, choose, short, spell
from gateway.config.schema import Config, GroupTable, LineTable, OperatorTable, SharedRulesTable, StarterTable
from gateway.config.site_tables import DEFAULT_EVERY_S, PointsTable, RowTable, additions, rows_of
from gateway.config.values import ConfigTable
from gateway.families import extension, load_profile
from gateway.starters import OWN_POINT_NAMES

SPARKPLUG_NAMESPACE = "spBv1.0"

Check = Callable[[Config], Iterable[Mistake]]
_OfStarters = OperatorTable | SharedRulesTable | GroupTable | PointsTable

_ONE_TARGET = "each starter needs its own name, and so does each group"  # a command's topic names one
_UNIQUE = {  # keys of which no two may be alike, and why
    LineTable: {
        "name": "each line needs its own name",
        "port": "put all starters of a port under one [[line]]",
    },
    StarterTable: {"name": _ONE_TARGET, "address": "each starter on a line needs its own address"},
    GroupTable: {"name": _ONE_TARGET},
    WebUserTable: {"name": "each login needs its own name"},
    RowTable: {"parameter": "describe each row once", "name": "each row needs its own name"},
}


def find_mistakes(config: Config, wrong: Iterable[Mistake], check: Check) -> list[Mistake]:
    """Return these mistakes, and those that all rules find besides; `check` is the last rule.

    A rule is judged without the values that those before it have found wrong; a value is named by one rule.
    """
    mistakes, tables = list(wrong), dict(config.tables())
    for kind, rule in (*_RULES, (Config, lambda config, _: check(config))):
        named = {mistake.key for mistake in mistakes}
        for key in named:
            depth = next(depth for depth in reversed(range(len(key))) if key[:depth] in tables)
            tables[key[:depth]].forget(key[depth])
        for at, table in tables.items():
            with WHERE_RIGHT:
                found = rule(table, config) if isinstance(table, kind) else ()
                keyed = (replace(mistake, key=(*at, *mistake.key)) for mistake in found)
                mistakes.extend(mistake for mistake in keyed if mistake.key not in named)
    return mistakes


def _alike(config: Config, _: Config) -> Iterator[Mistake]:
    """Yield values that another key has too: of addresses on the same line, of rows in the same family."""
    seen: dict[object, str] = {}
    for key, table in config.tables():
        for name, why in _UNIQUE.get(type(table), {}).items():
            with WHERE_RIGHT:
                scope = table.family if isinstance(table, RowTable) else key[1] if name == "address" else ""
                value = getattr(table, name)
                one = why, scope, posixpath.normpath(value) if name == "port" else value
                if one in seen:
                    yield Mistake((*key, name), f"{short(value)} is also {seen[one]}", why)
                seen.setdefault(one, spell((*key, name)))


def _unfitting(table: _OfStarters, config: Config) -> Iterator[Mistake]:
    """Yield patterns that fit no starter; of [[points]] also those that fit none of their family."""
    named = [starter for starter in config.starters if "name" in vars(starter)]
    for place, pattern in enumerate(table.starters if named and "starters" in table.model_fields_set else ()):
        fitting = [starter for starter in named if starter.is_among([pattern])]
        if not fitting:
            hint = choose(pattern, [starter.name for starter in named])
            yield Mistake(("starters", place), f"{short(pattern)} fits no starter", hint)
        elif isinstance(table, PointsTable):
            with WHERE_RIGHT:
                if table.family not in (families := sorted({starter.family for starter in fitting})):
                    hint = f"such starters are of {' and '.join(families)}"
                    yield Mistake(("starters", place), f"{short(pattern)} fits no {table.family}", hint)


def _stranger(table: WebUserTable | HomeAssistantTable | SparkplugTable, config: Config) -> Iterator[Mistake]:
    """Yield the client whose rights a login or a network is to have, where no operator has that name."""
    clients = [operator.client for operator in config.operators if "client" in vars(operator)]
    if table.operator and table.operator not in clients:
        hint = choose(table.operator, clients) if clients else "add an [[operator]] with this client"
        yield Mistake(("operator",), f"{short(table.operator)} is no [[operator]]'s client", hint)


def _wrong_codes(table: LineTable | StarterTable | PointsTable, config: Config) -> Iterator[Mistake]:
    """Yield codes and patterns that fit no readable row of the families of their table."""
    key = "codes" if isinstance(table, PointsTable) else "points"
    codes, starters = getattr(table, key), table.starters if isinstance(table, LineTable) else (table,)
    families = dict.fromkeys(starter.family for starter in starters) if codes else {}
    profiles = [extension.extended(load_profile(name), rows_of(name, config.rows), ()) for name in families]
    for place, code in enumerate(codes):
        if not any(extension.matching(profile, code) for profile in profiles):
            yield Mistake((key, place), *extension.why_no_row(profiles, code))


def _extend(line: LineTable, config: Config) -> Iterable[Mistake]:
    """Give each starter what the configuration adds to its family; return no mistake."""
    for starter in line.starters:
        try:
            asked = [(code, DEFAULT_EVERY_S) for code in (*line.points, *starter.points)]
            for table in config.points:
                if table.family == starter.family and starter.is_among(table.starters):
                    asked += [(code, table.every_s) for code in table.codes]
            starter.add(additions(starter.family, config.rows, asked))
        except WrongValueError:  # what its family would be with them is not known
            starter.forget("family")
    return ()


def _untraced(table: HistoryTable, config: Config) -> Iterator[Mistake]:
    """Yield points whose values are to be stored and that no starter has."""
    points = OWN_POINT_NAMES.union(*(starter.profile().points for starter in config.starters))
    for position, name in enumerate(table.values):
        if name not in points:
            hint = choose(name, sorted(points), otherwise="the topics B/starter/+/info list all points")
            yield Mistake(("values", position), f"{short(name)} is a point of no starter", hint)


def _half_feeder(starter: StarterTable, config: Config) -> Iterator[Mistake]:
    """Yield a starter with a feeder that is named without a time, or a time without a feeder."""
    rules = rules_of(config, starter)
    if bool(rules.feeder) != bool(rules.stagger_s):
        hint = "a feeder and the time between two starts on it go together"
        yield Mistake(("name",), "has only one of feeder and stagger_s", hint)


def _foreign_topics(table: HomeAssistantTable, config: Config) -> Iterator[Mistake]:
    """Yield topics that are the gateway's own, Sparkplug's or discovery's."""
    foreign: dict[str, Callable[[], str]] = {
        "the gateway's own": lambda: config.base,
        "Sparkplug's": lambda: SPARKPLUG_NAMESPACE,
        "discovery's": lambda: f"{table.discovery_prefix}/device",
    }
    for key, (whose, others_of) in product(("discovery_prefix", "birth_topic"), foreign.items()):
        with WHERE_RIGHT:
            topic, others = getattr(table, key) or "", others_of()
            if _is_one_in_the_other(topic, others) and (key, whose) != ("discovery_prefix", "discovery's"):
                yield Mistake((key,), f"lies among {whose} topics", f"a topic outside {short(others)}")


def _unserved(table: MetricsTable, config: Config) -> Iterator[Mistake]:
    """Yield metrics that nothing serves."""
    if table.textfile is None and config.web is None:
        hint = "add a [web] table, whose server answers /metrics, or a textfile for node-exporter"
        yield Mistake((), "nothing serves them", hint)


def _is_one_in_the_other(one: str, other: str) -> bool:
    """Return whether a topic is the other one, or one of its levels; False when there is none."""
    one, other = f"{one}/", f"{other}/"
    return one != "/" and (one.startswith(other) or other.startswith(one))


_RULES: tuple[tuple[type | UnionType, Callable[[Any, Config], Iterable[Mistake]]], ...] = (  # in this order
    (ConfigTable, lambda table, _: table.contradictions()),
    (_OfStarters, _unfitting),
    (WebUserTable | HomeAssistantTable | SparkplugTable, _stranger),
    (LineTable | StarterTable | PointsTable, _wrong_codes),
    (LineTable, _extend),
    (HistoryTable, _untraced),
    (Config, _alike),  # the rules before it judge also names that two tables have
    (StarterTable, _half_feeder),
    (HomeAssistantTable, _foreign_topics),
    (MetricsTable, _unserved),
)
