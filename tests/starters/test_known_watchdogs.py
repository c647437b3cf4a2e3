"""The watchdogs as last known: one that is admitted counts at once, for its line and other commands."""

from __future__ import annotations

from typing import Any

import pytest

from gateway.contract import CommandError
from gateway.families import Procedure, Variant, WriteStep, load_profile
from gateway.modbus.timing import Framing, LineTiming
from gateway.modbus.writes import WriteRegister
from gateway.starters.known_watchdogs import KnownWatchdogs
from gateway.starters.setup import StarterSetup

OLD = {"P313": (2,), "P314": (30,)}  # it stops the motor, after so many seconds


class Deadlines:
    """A line that keeps its deadlines, by address."""

    def __init__(self) -> None:
        self.now: dict[int, float | None] = {}

    def set_deadline(self, unit: int, seconds: float | None) -> None:
        self.now[unit] = seconds


def watched(baud: int = 19200, count: int = 1) -> tuple[KnownWatchdogs, Deadlines]:
    """Return starters whose watchdog of 30 s was read."""
    watchdogs, line = KnownWatchdogs(), Deadlines()
    timing, profile = LineTiming(baud, Framing.parse("8N2")), load_profile("ssw07")
    given: Any = line
    for n in range(1, count + 1):
        watchdogs.add(StarterSetup(f"pump-{n}", "pumps", n, profile, Variant(), timing=timing), given)
        watchdogs.note(f"pump-{n}", OLD)
    return watchdogs, line


def setting(seconds: int) -> Procedure:
    return Procedure((WriteStep(WriteRegister(314, seconds)),), None)


@pytest.mark.parametrize(
    ("seconds", "read_then", "counts_s"),
    [
        (5, None, 5.0),  # at once
        (5, {"P314": (5,)}, 5.0),
        (5, {"P314": (4,)}, 4.0),  # the newest reading, in any case
        (5, OLD, 30.0),
        (60, None, 30.0),  # the longer one counts once it is read
        (60, {"P314": (60,)}, 60.0),
    ],
)
async def test_a_shorter_watchdog_counts_from_its_admission_to_the_next_reading(
    seconds: int, read_then: dict[str, tuple[int, ...]] | None, counts_s: float
) -> None:
    watchdogs, line = watched()

    await watchdogs.admit("pump-1", setting(seconds))
    if read_then is not None:
        watchdogs.note("pump-1", read_then)

    assert line.now == {1: counts_s}


async def test_another_is_judged_by_those_admitted_and_a_refused_one_counts_no_more() -> None:
    watchdogs, line = watched(baud=2400, count=3)
    for name in ("pump-1", "pump-2"):
        await watchdogs.admit(name, setting(1))

    with pytest.raises(CommandError, match="pump-3: its watchdog of 1 s would act"):
        await watchdogs.admit("pump-3", setting(1))

    assert line.now == {1: 1.0, 2: 1.0, 3: 30.0}
