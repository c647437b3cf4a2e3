"""A restore that is interrupted leaves the starter safe; a long one is not cut short."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from gateway.families.profile.load import load_profile
from gateway.families.profile.schema import Variant
from gateway.line.direct import exclusive_line
from gateway.modbus.timing import Framing, LineTiming
from gateway.sim.bus.port import SimulatedLine
from gateway.sim.factory import make_unit
from gateway.starters.parameters.model import ParameterEntry, ParameterSet
from gateway.starters.parameters.offline_starter import OfflineStarter
from gateway.starters.parameters.restore import Restore, RestoreEnd
from gateway.starters.parameters.restore_plan import plan_restore
from gateway.starters.policy.write_budget import MOST_PER_HOUR
from gateway.starters.setup import StarterSetup
from tests.virtual_time import VirtualClock, run_virtually

TIMING = LineTiming(19200, Framing.parse("8N2"))


def restored(unit: Any, values: dict[str, int], *, after_s: float | None = None) -> tuple[RestoreEnd, int]:
    """Restore these values; return the end and how many writes it took. Interrupt it after so long."""

    async def run() -> tuple[RestoreEnd, int]:
        clock = VirtualClock(asyncio.get_running_loop())
        profile = load_profile(unit.family)
        setup = StarterSetup("pump", "pumps", 1, profile, Variant())
        async with exclusive_line("pumps", SimulatedLine(TIMING, [unit]).opener(), TIMING) as line:
            bench = OfflineStarter(setup, line=line, clock=clock)
            await bench.identify()
            entries = {code: ParameterEntry(value=value) for code, value in values.items()}
            wanted = ParameterSet("pump", unit.family, parameters=entries)
            seen = dict.fromkeys(values, (0,))
            plan = plan_restore(profile, bench.variant, wanted=wanted, seen=seen)
            work = Restore(bench, plan, clock=clock)
            if after_s == 0.0:
                work.interrupt()
            elif after_s is not None:
                asyncio.get_running_loop().call_later(after_s, work.interrupt)
            return await work.run(lambda _: None), work.writes

    return run_virtually(run())


def test_nothing_is_tried_after_an_interruption() -> None:
    unit = make_unit("ssw07", 1)

    end, writes = restored(unit, {"P314": 3}, after_s=0.0)

    assert writes == 0
    assert [change.code for change in end.untried] == ["P314"]
    assert list(unit.writes) == []


@pytest.mark.parametrize("after_s", [0.05, 0.1, 0.2, 0.3, 0.5])
def test_an_sst_is_never_left_in_its_configuration_mode(after_s: float) -> None:
    unit: Any = make_unit("sst", 1)

    end, _ = restored(unit, {"R41": 9, "R42": 20}, after_s=after_s)

    assert not unit.is_configuring
    assert end.done or end.failure is not None


def test_what_was_done_before_an_interruption_stays_and_is_listed() -> None:
    unit: Any = make_unit("ssw07", 1)

    end, _ = restored(unit, {"P314": 3, "P313": 0}, after_s=0.25)

    assert unit.settings[314] == 3
    assert "P314" in [change.code for change in (*end.done, *end.failed)]
    assert len(end.done) < 2


def test_a_restore_of_more_rows_than_commands_may_write_in_an_hour_is_carried_out_whole() -> None:
    unit: Any = make_unit("ssw900", 1)
    profile = load_profile("ssw900")
    wanted = {row.code: 1 for row in profile.parameters.values() if row.is_writable and row.words == 1}

    end, writes = restored(unit, wanted)

    assert len(end.done) > MOST_PER_HOUR
    assert (end.failed, end.untried) == ((), ())
    assert writes > MOST_PER_HOUR
