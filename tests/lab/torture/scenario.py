"""What a scenario is, which world it needs, and its row of the report."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Place:
    """A world of real processes; the scenarios of one place run one after the other in one world."""

    outlasts_hang: bool = False  # watchdogs outlast 1.5 times a hang's gap; else a crash's
    deaf_after_s: float = 15.0
    has_small_disk: bool = False  # the state is stored on a small disk of its own
    is_patient: bool = False  # a process that stands still for seconds is not taken for one that hangs
    mqtt: str = "auto"


CRASH, HANG, DISK = Place(), Place(outlasts_hang=True), Place(has_small_disk=True)
PORT = Place(deaf_after_s=3.0)
COMMANDS, OLD_MQTT = Place(is_patient=True), Place(is_patient=True, mqtt="3.1.1")


@dataclass(frozen=True)
class Scenario:
    """A fault; `run` is given the world and how much of it, on the rig also the row and the seed."""

    name: str
    place: Place | None  # None: a whole gateway in virtual time, on the rig of five doors
    run: Callable[..., Any]
    whole: int
    short: int
    unit: str  # of the count: times, s
    may_trip: bool = False  # the way to the starters is cut, so their watchdogs must act


@dataclass
class Row:
    """One line of the report."""

    name: str
    count: str
    failures: list[str] = field(default_factory=list)
    measurements: dict[str, Any] = field(default_factory=dict)
    took_s: float = 0.0

    def check(self, is_right: bool, what: str) -> None:
        """Note what does not hold."""
        if not is_right:
            self.failures.append(what)

    def __str__(self) -> str:
        shown = ", ".join(f"{key} {value}" for key, value in self.measurements.items())
        verdict = "FAILS" if self.failures else "holds"
        return f"{self.name:22} {self.count:>12}  {verdict}  {self.took_s:6.1f} s  {shown}"
