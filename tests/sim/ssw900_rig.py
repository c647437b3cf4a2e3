"""A simulated SSW900, and how it is talked to."""

from __future__ import annotations

from typing import Any

from gateway.modbus.reads import ReadHoldingRegisters
from gateway.modbus.writes import (
    WriteRegister,
)
from gateway.sim.factory import make_unit
from gateway.sim.ssw900.unit import Ssw900
from tests.sim.wire import Talk

WORD = 685
START = WriteRegister(WORD, 0x0013)


def make(**options: Any) -> tuple[Talk, Ssw900]:
    unit = make_unit("ssw900", 1, **options)
    assert isinstance(unit, Ssw900)
    return Talk(unit), unit


def running(**options: Any) -> tuple[Talk, Ssw900]:
    talk, unit = make(**options)
    talk.ask(START)
    talk.wait(10.0)
    return talk, unit


def read(talk: Talk, register: int) -> int:
    return int(talk.ask(ReadHoldingRegisters(register, 1))[0])


def status(talk: Talk) -> int:
    return read(talk, 680)
