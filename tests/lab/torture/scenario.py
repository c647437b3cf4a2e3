"""What a scenario is, and which world it needs."""

from __future__ import annotations

import enum
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from typing import Any

from tests.lab.torture.world import World


class Place(enum.Enum):
    """The worlds that scenarios share; those of one place run one after the other in one world."""

    CRASH = "crash"  # watchdogs outlast 1.5 times a crash's gap
    BROKER = "broker"  # the same, with a broker that keeps its sessions over a stop
    HANG = "hang"  # watchdogs outlast 1.5 times a hang's gap
    PORT = "port"  # a deaf port is noticed early; the line itself may be cut off, so watchdogs may act
    DISK = "disk"  # the state is stored on a small disk of its own
    COMMANDS = "commands"  # a process that stands still for seconds is not taken for one that hangs
    OLD_MQTT = "MQTT 3.1.1"  # the same, and the gateway speaks that


class Much(enum.Enum):
    """How much of each scenario."""

    WHOLE = enum.auto()
    SHORT = enum.auto()
    QUICK = enum.auto()


@dataclass(frozen=True)
class Scenario:
    """A fault with real processes; `run` is given the world and how much of it."""

    name: str
    place: Place
    run: Callable[[World, int], Awaitable[None]]
    whole: int
    short: int
    unit: str  # of the count: times, s
    quick: int = 0  # with --quick; 0: not there
    may_trip: bool = False  # the way to the starters is cut, so their watchdogs must act

    def count(self, much: Much) -> int:
        """Return how much that is here."""
        return {Much.WHOLE: self.whole, Much.SHORT: self.short, Much.QUICK: self.quick}[much]


@dataclass
class Row:
    """One line of the report."""

    name: str
    count: str
    failures: list[str] = field(default_factory=list)
    measurements: dict[str, Any] = field(default_factory=dict)
    took_s: float = 0.0

    def __str__(self) -> str:
        shown = ", ".join(f"{key} {value}" for key, value in self.measurements.items())
        verdict = "FAILS" if self.failures else "holds"
        return f"{self.name:22} {self.count:>12}  {verdict}  {self.took_s:6.1f} s  {shown}"
