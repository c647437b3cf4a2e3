"""Scenario tables: what is given, what happens when, and what must have been published by when.

`play` runs one row. Actions and expectations are words or functions of the plant; see README.md.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from math import inf
from typing import Any

import pytest

from tests.rig.broker import MqttMessage, matches
from tests.rig.plant import RigPlant

Action = str | Callable[[RigPlant], object]
Expectation = Callable[[RigPlant], str]  # returns what is wrong; empty: nothing

_WORD = re.compile(
    r"(?:unit )?(\S+) (\w+[\w.]*|(?:coil|discrete|holding|input) \d+) = (-|\d+|0x[0-9a-fA-F]+)"
)


@dataclass(frozen=True)
class ScenarioRow:
    """One scenario."""

    name: str
    given: str
    at: Mapping[float, Action | Iterable[Action]]
    then: Mapping[float, Expectation | Iterable[Expectation]]
    options: Mapping[str, Any] = field(default_factory=dict)  # of the plant


def row(
    name: str,
    *,
    given: str,
    then: Mapping[float, Expectation | Iterable[Expectation]],
    at: Mapping[float, Action | Iterable[Action]] | None = None,
    **options: Any,
) -> Any:
    """Return a row of a table that is `played`; its name is a sentence."""
    return pytest.param(ScenarioRow(name, given, at or {}, then, options), id=name)


def scene(
    name: str,
    given: str,
    at: Mapping[float, Action | Iterable[Action]],
    then_s: float,
    *then: Expectation,
    **options: Any,
) -> Any:
    """Return a row that is judged at one moment: name, what is given, what happens, when, what must be so."""
    return row(name, given=given, at=at, then={then_s: then}, **options)


def played(rows: Iterable[Any]) -> Callable[[ScenarioRow], None]:
    """Return the test that plays each row of a table: `test_starts = played(STARTS + STOPS)`."""

    @pytest.mark.parametrize("row", rows)
    def test(row: ScenarioRow) -> None:
        play(row)

    return test


def play(row: ScenarioRow) -> None:
    """Run a scenario; at the same second what happens comes before what must have happened."""
    with RigPlant(row.given, **row.options) as plant:
        for at_s in sorted({*row.at, *row.then}):
            plant.run(until=at_s)
            for action in _each(row.at.get(at_s, ())):
                act(plant, action)
            wrong = [said for each in _each(row.then.get(at_s, ())) if (said := each(plant))]
            assert not wrong, f"{row.name}, at {at_s} s: " + "\n".join(wrong)


def act(plant: RigPlant, action: Action) -> None:
    """Do one thing: a function of the plant, or words (README.md has the list)."""
    if callable(action):
        action(plant)
        return
    word = _WORD.fullmatch(action)
    what, *rest = action.split(maxsplit=2)
    if word is not None:
        plant.starter(word[1]).set_word(word[2], None if word[3] == "-" else int(word[3], 0))
    elif what == "broker":
        {
            "down": plant.broker.stop,
            "up": plant.broker.start,
            "stalls": plant.broker.stall,
            "goes": lambda: plant.broker.stall(is_stalled=False),
            "drops": plant.broker.drop,
        }[rest[0]]()
    elif what in ("restart", "end", "kill", "start"):
        getattr(plant, what)()
    elif what == "line":
        plant.do(getattr(plant.lines[rest[0]], rest[1]))
    else:  # a knob of a simulated starter
        starter = plant.starter(what)
        plant.do(lambda: starter.line.set_knob(starter.name, *rest))


# Actions


def command(path: str, **fields: Any) -> Action:
    """Publish a command on `command/STARTER/CLIENT/VERB`, with an id and a fresh token."""
    return lambda plant: plant.command(path, **fields)


def publish(topic: str, payload: Any = b"", **properties: Any) -> Action:
    return lambda plant: plant.publish(topic, payload, **properties)


def reload(toml: str) -> Action:
    return lambda plant: plant.reload(toml)


def fault(kind: str, starter: str, *args: Any, **options: Any) -> Action:
    """Have the starter's line do it a wrong: a method of `RigLine` (`lose`, `garble`, `silent`, ...)."""
    return lambda plant: plant.do(lambda: getattr(plant.line_of(starter), kind)(starter, *args, **options))


# Expectations


def msg(topic: str, **fields: Any) -> Expectation:
    """The newest message of the topic has these fields."""

    def check(plant: RigPlant) -> str:
        found = plant.messages(topic)
        if not found:
            return f"nothing was published on {topic}"
        return _difference(found[-1], fields)

    return check


def seen(topic: str, *, times: int | None = None, since: float = 0.0, **fields: Any) -> Expectation:
    """Some message of the topic had these fields; or exactly so many had."""

    def check(plant: RigPlant) -> str:
        found = plant.messages(topic, since)
        count = sum(not _difference(each, fields) for each in found)
        if count == times if times is not None else count:
            return ""
        newest = "\n".join(f"  {str(each)[:400]}" for each in found[-12:])
        return f"{count} messages of {topic} with {fields}, of {len(found)}:\n{newest}"

    return check


def never(topic: str, *, since: float = 0.0, **fields: Any) -> Expectation:
    """No message of the topic had these fields."""
    return seen(topic, times=0, since=since, **fields)


def apart(topic: str, least_s: float, most_s: float = inf, *, since: float = 0.0) -> Expectation:
    """The messages of the topic are so far apart, and there are several."""

    def check(plant: RigPlant) -> str:
        gaps_s = [after.at_s - before.at_s for before, after in pairwise(plant.messages(topic, since))]
        is_so = bool(gaps_s) and least_s - 0.001 <= min(gaps_s) and max(gaps_s) <= most_s
        return "" if is_so else f"messages of {topic} are {gaps_s} s apart"

    return check


def retained(topic: str, **fields: Any) -> Expectation:
    """The broker retains this; without fields: nothing on the topic."""

    def check(plant: RigPlant) -> str:
        found = [m for m in plant.broker.retained_now() if matches(plant.topic(topic), m.topic)]
        if not fields:
            return f"retained: {found[-1]}" if found else ""
        return _difference(found[-1], fields) if found else f"nothing is retained on {topic}"

    return check


def results(*expected: str, starter: str = "+", client: str = "+") -> Expectation:
    """All results so far, each as `verb phase code`."""
    return lambda plant: _unequal(list(expected), plant.results(starter, client))


def result(words: str, starter: str = "+", client: str = "+") -> Expectation:
    """The newest result is `verb phase code`."""
    return lambda plant: _unequal([words], plant.results(starter, client)[-1:])


def event(code: str | re.Pattern[str], topic: str = "gateway/event", **fields: Any) -> Expectation:
    """There was such an event of the gateway, or of a starter (`topic="starter/pump/event"`)."""
    return seen(topic, code=code, **fields)


def frames(starter: str, *pdus: str, since: float = 0.0) -> Expectation:
    """Exactly these writes reached the starter, as PDUs in hex (`05 00 64 ff 00`)."""
    return lambda plant: _unequal(
        [each.lower() for each in pdus], [pdu for at_s, pdu in plant.starter(starter).writes if at_s >= since]
    )


def that(found: Callable[[RigPlant], Any], wanted: Any = True) -> Expectation:
    """What is found is this: a value, a pattern, `...`, or a mapping that has a part of it."""
    return lambda plant: _unlike(found(plant), wanted)


def clean_line(plant: RigPlant) -> str:
    """The gateway has observed every silence of its lines."""
    return "\n".join(each for line in plant.lines.values() for each in line.violations)


# Below


def _each(given: Any) -> Iterable[Any]:
    return (given,) if callable(given) or isinstance(given, str) else given


def _unequal(expected: list[str], found: list[str]) -> str:
    return "" if expected == found else f"expected {expected}, found {found}"


def _difference(message: MqttMessage, fields: Mapping[str, Any]) -> str:
    """Return how a message differs from the fields; `retain` and `qos` are the message's own."""
    for name in ("retain", "qos"):
        if name in fields and getattr(message, name) != fields[name]:
            return f"{name} is {getattr(message, name)}: {str(message)[:600]}"
    wanted = {name: value for name, value in fields.items() if name not in ("retain", "qos")}
    if not wanted:
        return ""
    try:
        body = message.json
    except ValueError:
        return f"no JSON: {str(message)[:600]}"
    wrong = _unlike(body, wanted)
    return f"{wrong}: {str(message)[:600]}" if wrong else ""


def _unlike(found: Any, wanted: Any, where: str = "") -> str:
    """Return where a value differs: `...` is anything, a pattern is searched, a mapping is a part."""
    if wanted is ...:
        return ""
    if isinstance(wanted, Mapping):
        if not isinstance(found, Mapping):
            return f"{where or 'it'} is {found!r}"
        for name, value in wanted.items():
            if name not in found:
                return f"{where}{name} is missing"
            if wrong := _unlike(found[name], value, f"{where}{name} "):
                return wrong
        return ""
    if isinstance(wanted, re.Pattern):
        return "" if isinstance(found, str) and wanted.search(found) else f"{where}is {found!r}"
    return (
        ""
        if found == wanted and isinstance(found, bool) == isinstance(wanted, bool)
        else f"{where}is {found!r}"
    )
