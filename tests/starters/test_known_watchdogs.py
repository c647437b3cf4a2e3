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

OLD, NEW = {"P313": (2,), "P314": (30,)}, {"P313": (2,), "P314": (1,)}
SET_NEW = Procedure((WriteStep(WriteRegister(314, 1)),), None)


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


async def test_the_old_row_read_again_does_not_take_an_admitted_watchdog_back() -> None:
    watchdogs, (pump,), line = watched()

    await watchdogs.admit("pump-1", SET_NEW)
    watchdogs.note("pump-1", OLD)

    assert (watchdogs.limit_s(pump), line.now) == (1.0, {1: 1.0})
    assert watchdogs.known()["pump-1"].rows == NEW


async def test_another_is_judged_by_what_is_admitted_and_not_yet_read() -> None:
    watchdogs, _, line = watched(baud=2400, count=3)
    for name in ("pump-1", "pump-2"):
        await watchdogs.admit(name, SET_NEW)
        watchdogs.note(name, OLD)

    with pytest.raises(CommandError, match="pump-3: its watchdog of 1 s would act"):
        await watchdogs.admit("pump-3", SET_NEW)

    assert line.now == {1: 1.0, 2: 1.0, 3: 30.0}


async def test_once_it_is_read_alike_the_next_reading_counts() -> None:
    watchdogs, (pump,), line = watched()

    await watchdogs.admit("pump-1", SET_NEW)
    watchdogs.note("pump-1", NEW)
    watchdogs.note("pump-1", OLD)

    assert (watchdogs.limit_s(pump), line.now) == (30.0, {1: 30.0})


@pytest.mark.parametrize(("is_written", "limit_s"), [(True, 1.0), (False, 30.0)])
async def test_what_is_not_read_by_the_end_counts_if_it_may_be_written(
    is_written: bool, limit_s: float
) -> None:
    watchdogs, (pump,), line = watched()

    await watchdogs.admit("pump-1", SET_NEW)
    watchdogs.note("pump-1", OLD)
    watchdogs.end("pump-1", is_written=is_written)
    assert (watchdogs.limit_s(pump), line.now) == (limit_s, {1: limit_s})

    watchdogs.note("pump-1", OLD)
    assert (watchdogs.limit_s(pump), line.now) == (30.0, {1: 30.0})


async def test_a_shorter_one_that_is_read_meanwhile_counts() -> None:
    watchdogs, (pump,), _ = watched()

    await watchdogs.admit("pump-1", Procedure((WriteStep(WriteRegister(314, 5)),), None))
    watchdogs.note("pump-1", NEW)

    assert watchdogs.limit_s(pump) == 1.0
