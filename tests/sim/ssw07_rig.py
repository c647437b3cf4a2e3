"""A simulated SSW-07, and how it is talked to."""

from __future__ import annotations

from typing import Any

from gateway.modbus.reads import ReadHoldingRegisters
from gateway.modbus.writes import WriteCoil
from gateway.sim.factory import make_unit
from gateway.sim.weg.ssw07 import Ssw07
from tests.sim.wire import Talk

START = WriteCoil(100, is_on=True)
STOP = WriteCoil(100, is_on=False)
RESET = WriteCoil(107, is_on=True)
STATUS = ReadHoldingRegisters(5001, 1)


def make(**options: Any) -> tuple[Talk, Ssw07]:
    unit = make_unit("ssw07", 1, **options)
    assert isinstance(unit, Ssw07)
    return Talk(unit), unit


def running(**options: Any) -> tuple[Talk, Ssw07]:
    talk, unit = make(**options)
    talk.ask(START)
    talk.wait(10.0)
    return talk, unit


def status(talk: Talk) -> int:
    return int(talk.ask(STATUS)[0])
