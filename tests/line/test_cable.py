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
LIMIT_S = 0.2


@dataclass
class CableLine:
    """Some starters; each has shares of replies that are corrupted, lost or late."""

    count: int
    seed: int
    per_s: float = 1.0  # requests to each starter
    corrupted: dict[int, float] = field(default_factory=dict)
    lost: dict[int, float] = field(default_factory=dict)
    late: dict[int, float] = field(default_factory=dict)
    off: set[int] = field(default_factory=set)
    now_s: float = 0.0
    appeared: list[str] = field(default_factory=list)
    gone: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.random = random.Random(self.seed)
        order = range(1, self.count + 1)
        self.health = CableHealth([WiredStarter(f"pump-{each}", each, LIMIT_S) for each in order])
        self.units: dict[int, dict[str, Any]] = {
            each: {"asked": 0, "silent": 0, "corrupted": 0, "late": 0, "state": "answering"} for each in order
        }

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
        return self.texts

    @property
    def texts(self) -> list[str]:
        found: list[str] = self.health.to_dict()["texts"]
        return found

    def _ask(self, address: int, unit: dict[str, Any]) -> None:
        """Ask as often as a line does in half a minute; one that is off is probed once."""
        unit["response_time_s"] = {"p50": 0.01, "p99": 0.02}
        if address in self.off:
            unit["asked"] += 1 if unit["state"] == "silent" else 3
            unit["silent"] += 1 if unit["state"] == "silent" else 3
            unit["state"] = "silent"
            return
        unit["state"] = "answering"
        corrupted, lost = self.corrupted.get(address, 0.0), self.lost.get(address, 0.0)
        late = self.late.get(address, 0.0)
        for _ in range(round(STEP_S * self.per_s)):
            unit["asked"] += 1
            chance = self.random.random()
            if chance < corrupted:
                unit["corrupted"] += 1
            elif chance < corrupted + lost:
                unit["silent"] += 1
            elif chance < corrupted + lost + late:
                unit["silent"] += 1
                unit["late"] += 1


LINES = 5  # of each kind of fault


def shares(chance: random.Random, addresses: range, least: float = 0.04) -> dict[int, float]:
    """As a common cause has it: not the same share everywhere."""
    return {address: chance.uniform(least, 3 * least) for address in addresses}


def good(count: int, seed: int, chance: random.Random) -> tuple[CableLine, str]:
    usual = {address: chance.uniform(0.0, 0.001) for address in range(1, count + 1)}
    return CableLine(count, seed, corrupted=usual), ""


def broken_after(count: int, seed: int, chance: random.Random) -> tuple[CableLine, str]:
    last = chance.randrange(1, count - 1)
    line = CableLine(count, seed, corrupted=shares(chance, range(last + 1, count + 1)))
    line.lost = shares(chance, range(last + 1, count + 1), 0.01)
    return line, f"from pump-{last + 1} (address {last + 1}) on: check the cable after pump-{last} "


def noise(count: int, seed: int, chance: random.Random) -> tuple[CableLine, str]:
    return CableLine(count, seed, corrupted=shares(chance, range(1, count + 1))), "errors of all starters"


def one_bad(count: int, seed: int, chance: random.Random) -> tuple[CableLine, str]:
    bad = chance.randint(1, count)
    return CableLine(
        count, seed, corrupted={bad: 0.06}, lost={bad: 0.02}
    ), f"errors of pump-{bad} (address {bad}) only"


def one_slow(count: int, seed: int, chance: random.Random) -> tuple[CableLine, str]:
    slow = chance.randint(1, count)
    return CableLine(count, seed, late={slow: 0.08}), f"late replies of pump-{slow} "


def one_off(count: int, seed: int, chance: random.Random) -> tuple[CableLine, str]:
    return CableLine(count, seed, off={chance.randint(1, count)}), ""


def cut_after(count: int, seed: int, chance: random.Random) -> tuple[CableLine, str]:
    last = chance.randrange(1, count - 1)
    return CableLine(count, seed, off=set(range(last + 1, count + 1))), f"no replies from pump-{last + 1} "


Kind = Callable[[int, int, random.Random], tuple[CableLine, str]]


@pytest.mark.parametrize("kind", [good, broken_after, noise, one_bad, one_slow, one_off, cut_after])
@pytest.mark.parametrize("per_s", [0.5])
def test_of_many_lines_with_a_fault_of_a_kind_each_is_named_as_what_it_is(kind: Kind, per_s: float) -> None:
    wrong, unsteady = [], 0
    for seed in range(LINES):
        chance = random.Random(f"{kind.__name__} {seed}")
        line, expected = kind(chance.randint(3, 16), seed, chance)
        line.per_s = per_s
        texts = line.run(1.0)
        is_right = len(texts) == 1 and expected in texts[0] if expected else texts == []
        if not is_right:
            wrong.append((seed, expected, texts))
        unsteady += len(line.appeared) > 1  # another sentence before, of few requests

    assert wrong == []
    assert unsteady <= 2


def test_sentences_appear_once_and_go_when_the_cable_is_repaired() -> None:
    line = CableLine(8, seed=3, corrupted=dict.fromkeys((6, 7, 8), 0.1))
    line.run(2)
    assert [text[:42] for text in line.appeared] == ["errors from pump-6 (address 6) on: check t"]
    line.corrupted = {}

    assert line.run(0.3) == []

    assert len(line.gone) == len(line.appeared) == 1
    assert line.run(24) == []
    assert len(line.appeared) == 1


@pytest.mark.parametrize(("count", "of"), [(0, 600), (10, 100), (3, 7), (5, 5)])
def test_the_share_seen_is_just_within_reach_of_both_bounds(count: int, of: int) -> None:
    """The definition of Wilson's interval: as many standard deviations of the bound's own distribution."""
    for bound in bounds(count, of):
        away = abs(count / of - bound)
        assert away == pytest.approx(2.576 * sqrt(bound * (1 - bound) / of), abs=1e-9)
