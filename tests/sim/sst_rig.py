"""A simulated SST, and how it is talked to."""

from __future__ import annotations

from typing import Any

from gateway.modbus.reads import ReadCoils, ReadInputRegisters
from gateway.modbus.writes import WriteCoil, WriteRegister
from gateway.sim.factory import make_unit
from gateway.sim.sst.unit import Sst
from tests.sim.wire import Talk


def coil(number: int, *, is_on: bool = True) -> WriteCoil:
    return WriteCoil(number - 1, is_on)


START, STOP = coil(1), coil(1, is_on=False)


def make(**options: Any) -> tuple[Talk, Sst]:
    unit = make_unit("sst", 1, **options)
    assert isinstance(unit, Sst)
    return Talk(unit), unit


def running(**options: Any) -> tuple[Talk, Sst]:
    talk, unit = make(**options)
    talk.ask(START)
    talk.wait(10.0)
    assert unit.motor.is_at_full_voltage
    return talk, unit


def ones(talk: Talk) -> set[int]:
    """Return the numbers of the coils that are 1."""
    return {number for number, is_set in enumerate(talk.ask(ReadCoils(0, 26)), 1) if is_set}


def register(talk: Talk, number: int) -> int:
    return int(talk.ask(ReadInputRegisters(number, 1))[0])


def initialise(talk: Talk, changes: dict[int, int] | None = None) -> None:
    talk.ask(coil(2))
    for number, value in (changes or {}).items():
        talk.ask(WriteRegister(number, value))
    talk.ask(coil(2, is_on=False))
    talk.wait(1.0)
