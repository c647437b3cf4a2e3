"""Lines whose replies go wrong by chance, in a pattern that is known: what `CableHealth` says is counted."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass, field
from math import sqrt
from typing import Any

import pytest

from gateway.line.cable import CableHealth, WiredStarter, bounds

STEP_S = 30.0
LINES = 5  # of each kind of fault
KINDS = ("corrupted", "lost", "late")


@dataclass
class CableLine:
    """Some starters; each has shares of replies that are corrupted, lost and late."""

    count: int
    seed: int
    per_s: float = 1.0  # requests to each starter
    shares: dict[int, tuple[float, float, float]] = field(default_factory=dict)
    off: set[int] = field(default_factory=set)
    now_s: float = 0.0
    appeared: list[str] = field(default_factory=list)
    gone: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.random = random.Random(self.seed)
        order = range(1, self.count + 1)
        self.health = CableHealth([WiredStarter(f"pump-{each}", each, 0.2) for each in order])
        none = {"asked": 0, "silent": 0, "corrupted": 0, "late": 0, "state": "answering"}
        times = {"response_time_s": {"p50": 0.01, "p99": 0.02}}
        self.units: dict[int, dict[str, Any]] = {each: {**none, **times} for each in order}

    def run(self, hours: float) -> list[str]:
        """Let time pass and return the sentences at its end."""
        until_s = self.now_s + hours * 3600
        while self.now_s < until_s:
            self.now_s += STEP_S
            for address, unit in self.units.items():
                self._ask(address, unit)
            changes = self.health.take({"units": self.units, "is_open": True}, self.now_s)
            self.appeared += changes.appeared
            self.gone += changes.gone
        texts: list[str] = self.health.to_dict()["texts"]
        return texts

    def _ask(self, address: int, unit: dict[str, Any]) -> None:
        """Ask as often as a line does in half a minute; one that is off is probed once."""
        if address in self.off:
            count = 1 if unit["state"] == "silent" else 3
            unit["asked"] += count
            unit["silent"] += count
            unit["state"] = "silent"
            return
        shares = self.shares.get(address, (0.0, 0.0, 0.0))
        for _ in range(round(STEP_S * self.per_s)):
            unit["asked"] += 1
            (kind,) = self.random.choices((*KINDS, ""), (*shares, 1 - sum(shares)))
            if kind:
                unit["corrupted" if kind == "corrupted" else "silent"] += 1
            unit["late"] += kind == "late"


Bad = dict[int, tuple[float, float, float]] | set[int]


def bad(addresses: range, chance: random.Random, lost: float = 0.0) -> Bad:
    """As a common cause has it: not the same share everywhere."""
    return {each: (chance.uniform(0.04, 0.12), chance.uniform(lost, 3 * lost), 0.0) for each in addresses}


# By name: which replies go wrong on a line of so many starters, one of which was chosen; and what is said.
FAULTS: dict[str, tuple[Callable[[int, int, random.Random], Bad], str]] = {
    "none": (
        lambda count, _, chance: {n: (chance.uniform(0.0, 0.001), 0, 0) for n in range(1, count + 1)},
        "",
    ),
    "broken after": (
        lambda count, at, chance: bad(range(at + 1, count + 1), chance, lost=0.01),
        "from pump-{after} (address {after}) on: check the cable after pump-{at} ",
    ),
    "noise": (lambda count, _, chance: bad(range(1, count + 1), chance), "errors of all starters"),
    "one bad": (lambda _, at, __: {at: (0.06, 0.02, 0.0)}, "errors of pump-{at} (address {at}) only"),
    "one slow": (lambda _, at, __: {at: (0.0, 0.0, 0.08)}, "late replies of pump-{at} "),
    "one off": (lambda _, at, __: {at}, ""),
    "cut after": (lambda count, at, _: set(range(at + 1, count + 1)), "no replies from pump-{after} "),
}


@pytest.mark.parametrize("name", FAULTS)
def test_of_many_lines_with_a_fault_of_a_kind_each_is_named_as_what_it_is(name: str) -> None:
    fault, words = FAULTS[name]
    wrong, unsteady = [], 0
    for seed in range(LINES):
        chance = random.Random(f"{name} {seed}")
        count = chance.randint(3, 16)
        at = chance.randrange(1, count - 1)
        found, expected = fault(count, at, chance), words.format(at=at, after=at + 1)
        line = CableLine(count, seed, per_s=0.5)
        line.off, line.shares = (found, {}) if isinstance(found, set) else (set(), found)
        texts = line.run(1.0)
        if [expected in text for text in texts] != [True] * bool(expected):
            wrong.append((seed, expected, texts))
        unsteady += len(line.appeared) > 1  # another sentence before, of few requests

    assert wrong == []
    assert unsteady <= 2


def test_sentences_appear_once_and_go_when_the_cable_is_repaired() -> None:
    line = CableLine(8, seed=3, shares=dict.fromkeys((6, 7, 8), (0.1, 0.0, 0.0)))
    line.run(2)
    assert [text[:42] for text in line.appeared] == ["errors from pump-6 (address 6) on: check t"]
    line.shares = {}

    assert line.run(0.3) == []

    assert len(line.gone) == len(line.appeared) == 1
    assert line.run(8) == []
    assert len(line.appeared) == 1


@pytest.mark.parametrize(("count", "of"), [(0, 600), (10, 100), (3, 7), (5, 5)])
def test_the_share_seen_is_just_within_reach_of_both_bounds(count: int, of: int) -> None:
    """The definition of Wilson's interval: as many standard deviations of the bound's own distribution."""
    for bound in bounds(count, of):
        away = abs(count / of - bound)
        assert away == pytest.approx(2.576 * sqrt(bound * (1 - bound) / of), abs=1e-9)
