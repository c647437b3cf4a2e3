"""Seeded second starts: whatever the moment, the time of a simulated starter passes."""

from __future__ import annotations

import random
import time

import pytest

from gateway.modbus.writes import WriteCoil, WriteRegister
from gateway.sim.factory import make_unit
from tests.sim.sst_rig import START, STOP, make
from tests.sim.wire import Talk


@pytest.mark.parametrize("seed", range(40))
def test_an_sst130i_that_is_started_again_starts_once_its_capacitor_is_discharged(seed: int) -> None:
    dice = random.Random(seed)
    talk, unit = make(model="SST130i-140")
    talk.wait(dice.uniform(0.0, 1e6))
    talk.ask(START)
    talk.wait(dice.uniform(0.5, 5.0))
    talk.ask(STOP)
    talk.wait(dice.uniform(0.0, 3.0))
    ends_by_s = time.process_time() + 5.0

    talk.ask(START)
    talk.wait(8.0)

    assert unit.motor.is_turned_on
    assert time.process_time() < ends_by_s


@pytest.mark.parametrize("family", ["ssw06", "ssw07", "ssw900", "sst"])
def test_two_hundred_starts_and_stops_at_any_moment_pass_in_no_time(family: str) -> None:
    dice = random.Random(7)
    unit = make_unit(family, 1, **({"model": "SST130i-140"} if family == "sst" else {}))
    talk = Talk(unit)
    ends_by_s = time.process_time() + 20.0

    for _ in range(200):
        if family == "sst":
            talk.ask(WriteCoil(0, is_on=dice.random() < 0.5))
        elif dice.random() < 0.5:
            talk.ask(WriteRegister(685, 0x13) if family == "ssw900" else WriteCoil(100, is_on=True))
        else:
            unit.set_mains(is_present=dice.random() < 0.8)
        talk.wait(dice.choice([0.0, 1e-12, dice.random(), dice.uniform(0, 30)]))

    assert unit.now_s == talk.now_s
    assert time.process_time() < ends_by_s
