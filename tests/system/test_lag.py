"""How late a loop is, in its worst moment."""

from __future__ import annotations

import asyncio

import pytest

from gateway.system.stalls import TICK_S, LagMeter
from tests.virtual_time import VirtualTimeLoop, run_virtually


def test_the_worst_delay_of_this_minute_and_the_one_before_it_counts() -> None:
    meter = LagMeter()

    meter.note(0.3, 0.0)
    meter.note(0.1, 59.0)
    first_s = meter.worst_s
    meter.note(0.2, 60.0)
    second_s = meter.worst_s
    meter.note(0.0, 120.0)
    third_s = meter.worst_s
    meter.note(0.0, 180.0)

    assert (first_s, second_s, third_s, meter.worst_s) == (0.3, 0.3, 0.2, 0.0)


def test_a_loop_that_stood_still_is_late_by_that_time_less_a_tick() -> None:
    async def scenario() -> float:
        meter = LagMeter()
        measuring = asyncio.create_task(meter.run())
        await asyncio.sleep(1.01)
        assert meter.worst_s == pytest.approx(0.0, abs=1e-6)
        loop = asyncio.get_running_loop()
        assert isinstance(loop, VirtualTimeLoop)
        loop.work(0.5)
        await asyncio.sleep(0.1)
        measuring.cancel()
        return meter.worst_s

    worst_s = run_virtually(scenario())

    assert 0.5 - TICK_S <= worst_s <= 0.5
