"""A simulated SSW-06, and how it is talked to."""

from __future__ import annotations

from typing import Any

from gateway.modbus.reads import ReadHoldingRegisters
from gateway.modbus.writes import WriteRegister
from gateway.sim.factory import make_unit
from gateway.sim.weg.ssw06 import Ssw06
from tests.sim.wire import Talk

VB03 = 5003
START = WriteRegister(VB03, 0x0101)
STATUS = ReadHoldingRegisters(5001, 1)


def make(**options: Any) -> tuple[Talk, Ssw06]:
    unit = make_unit("ssw06", 1, **options)
    assert isinstance(unit, Ssw06)
    return Talk(unit), unit


def running(**options: Any) -> tuple[Talk, Ssw06]:
    talk, unit = make(**options)
    talk.ask(START)
    talk.wait(10.0)
    return talk, unit


def status(talk: Talk) -> int:
    return int(talk.ask(STATUS)[0])
