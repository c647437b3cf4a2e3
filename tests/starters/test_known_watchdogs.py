"""The watchdogs as last known: what is admitted counts until it is read, whatever is read before."""

from __future__ import annotations

from typing import Any

import pytest

from gateway.contract import CommandError
from gateway.families import Procedure, Variant, WriteStep, load_profile
from gateway.modbus.timing import Framing, LineTiming
from gateway.modbus.writes import WriteRegister
from gateway.starters.known_watchdogs import KnownWatchdogs
from gateway.starters.setup import StarterSetup
from gateway.store import Documents

OLD = {"P313": (2,), "P314": (30,)}


class Deadlines:
    """A line that keeps its deadlines, by address."""

    def __init__(self) -> None:
        self.now: dict[int, float | None] = {}

    def set_deadline(self, unit: int, seconds: float | None) -> None:
        self.now[unit] = seconds


def watched(baud: int = 19200, count: int = 1) -> tuple[KnownWatchdogs, list[StarterSetup], Deadlines]:
    """Return starters whose watchdog of 30 s was read."""
    watchdogs, line = KnownWatchdogs(Documents()), Deadlines()
    timing, profile = LineTiming(baud, Framing.parse("8N2")), load_profile("ssw07")
    setups = [StarterSetup(f"pump-{n}", "pumps", n, profile, Variant(), timing) for n in range(1, count + 1)]
    for setup in setups:
        given: Any = line
        watchdogs.add(setup, given)
        watchdogs.note(setup.name, OLD)
    return watchdogs, setups, line


def setting(seconds: int) -> Procedure:
    return Procedure((WriteStep(WriteRegister(314, seconds)),), None)


@pytest.mark.parametrize(
    ("history", "limit_s"),
    [
        ("admit 1, read 30", 1),  # the old row read again does not take it back
        ("admit 1, read 1, read 30", 30),  # once it is read alike the next reading counts
        ("admit 5, read 1", 1),  # so does a shorter one that is read meanwhile
        ("admit 1, read 30, written", 1),  # it counts if it may be written,
        ("admit 1, read 30, written, read 30", 30),  # until the next reading
        ("admit 1, read 30, dropped", 30),
        ("admit 40, read 30", 30),  # the line keeps a longer one, too, until that is read
    ],
)
async def test_an_admitted_watchdog_counts_until_it_is_read_or_known_not_to_be_written(
    history: str, limit_s: int
) -> None:
    watchdogs, (pump,), line = watched()

    for what, *seconds in map(str.split, history.split(", ")):
        if what == "admit":
            await watchdogs.admit("pump-1", setting(int(seconds[0])))
        elif what == "read":
            watchdogs.note("pump-1", {**OLD, "P314": (int(seconds[0]),)})
        else:
            watchdogs.end("pump-1", is_written=what == "written")

    assert (watchdogs.limit_s(pump), line.now) == (limit_s, {1: limit_s})


async def test_another_is_judged_by_what_is_admitted_and_not_yet_read() -> None:
    watchdogs, _, line = watched(baud=2400, count=3)
    for name in ("pump-1", "pump-2"):
        await watchdogs.admit(name, setting(1))
        watchdogs.note(name, OLD)

    with pytest.raises(CommandError, match="pump-3: its watchdog of 1 s would act"):
        await watchdogs.admit("pump-3", setting(1))

    assert line.now == {1: 1.0, 2: 1.0, 3: 30.0}
    assert watchdogs.known()["pump-1"].rows == {**OLD, "P314": (1,)}  # for the next run
