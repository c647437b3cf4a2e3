"""Lines whose replies go wrong by chance, in a pattern that is known: what `CableHealth` says is counted."""

from __future__ import annotations

import random
from dataclasses import dataclass, field
from typing import Any

from gateway.line.cable import CableHealth, WiredStarter

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
