"""The registers of the simulated SSW900: sections 7.2 and 7.3 of its manual (rules S9-xx)."""

from __future__ import annotations

from typing import Any

import pytest

from gateway.modbus.reads import ReadCoils, ReadDiscreteInputs, ReadHoldingRegisters, ReadInputRegisters
from gateway.modbus.writes import (
    ReadWriteRegisters,
    WriteCoil,
    WriteCoils,
    WriteRegister,
    WriteRegisters,
)
from tests.sim.ssw900_rig import START, make

USER_1 = 1110  # C11.3.1, signed, 32 bits


@pytest.mark.parametrize(
    "request_",
    [ReadCoils(0, 1), ReadDiscreteInputs(0, 1), WriteCoil(0, is_on=True), WriteCoils(0, (True,))],
)
def test_s9_01_coils_are_for_softplc_markers_only(request_: Any) -> None:
    talk, _ = make()

    assert talk.code(request_) == 2


def test_s9_01_markers_of_the_softplc_are_coils_and_discrete_inputs() -> None:
    talk, _ = make(coils={10: False, 11: True, 12: False}, discrete_inputs={5: True, 6: False, 7: True})

    assert talk.ask(ReadDiscreteInputs(5, 3)) == (True, False, True)
    assert talk.code(ReadDiscreteInputs(7, 2)) == 2
    assert talk.code(ReadDiscreteInputs(10, 1)) == 2
    talk.ask(WriteCoil(10, is_on=True))
    talk.ask(WriteCoils(11, (False, True)))
    assert talk.ask(ReadCoils(10, 3)) == (True, False, True)
    assert talk.code(WriteCoil(5, is_on=True)) == 2


def test_s9_01_there_are_no_input_registers() -> None:
    talk, _ = make()

    assert talk.code(ReadInputRegisters(680, 1)) == 1


def test_s9_02_in_a_long_read_registers_that_are_no_parameter_read_0() -> None:
    talk, unit = make()
    unit.fixed[9] = 700

    assert talk.ask(ReadHoldingRegisters(18, 4)) == (1, 0, 0, talk.ask(ReadHoldingRegisters(21, 1))[0])
    assert talk.ask(ReadHoldingRegisters(2000, 3)) == (0, 0, 0)


@pytest.mark.parametrize("request_", [ReadHoldingRegisters(19, 1), ReadHoldingRegisters(18, 2)])
def test_s9_02_in_a_short_read_they_get_exception_2(request_: Any) -> None:
    talk, _ = make()

    assert talk.code(request_) == 2


def test_s9_03_in_a_long_write_what_cannot_be_written_is_passed_over() -> None:
    talk, _ = make()

    assert talk.code(WriteRegisters(229, (4, 3, 1, 77))) is None  # 232 is read-only

    assert talk.ask(ReadHoldingRegisters(229, 3)) == (4, 3, 1)


@pytest.mark.parametrize(
    "request_", [WriteRegister(680, 1), WriteRegister(19, 1), WriteRegisters(231, (0, 0))]
)
def test_s9_03_in_a_short_write_it_gets_exception_2(request_: Any) -> None:
    talk, _ = make()

    assert talk.code(request_) == 2


@pytest.mark.parametrize(
    "request_",
    [
        ReadHoldingRegisters(24, 1),
        ReadHoldingRegisters(25, 2),
        ReadHoldingRegisters(22, 3),
        WriteRegister(USER_1, 0),
        WriteRegisters(USER_1 + 1, (0, 0, 0)),
    ],
)
def test_s9_04_a_part_of_a_longer_type_gets_exception_2(request_: Any) -> None:
    talk, _ = make()

    assert talk.code(request_) == 2


def test_s9_05_the_low_word_comes_first() -> None:
    talk, unit = make(serial_number=0x00123456)

    assert talk.ask(ReadHoldingRegisters(298, 2)) == (0x3456, 0x0012)
    unit.fixed.clear()
    talk.ask(WriteRegisters(USER_1, (0xFFFF, 0xFFFF)))  # -1
    assert talk.ask(ReadHoldingRegisters(USER_1, 2)) == (0xFFFF, 0xFFFF)


def test_s9_09_stopped_parameters_do_not_change_while_the_motor_turns() -> None:
    talk, _ = make()
    talk.ask(START)
    talk.wait(5.0)

    assert talk.code(WriteRegister(1300, 680)) is None
    assert talk.ask(ReadHoldingRegisters(1300, 1)) == (0,)
    talk.ask(WriteRegister(899, 5))
    assert talk.ask(ReadHoldingRegisters(899, 1)) == (5,)


@pytest.mark.parametrize(
    "request_", [WriteRegister(229, 6), WriteRegister(931, 4), WriteRegisters(229, (9, 0, 0))]
)
def test_s9_23_a_value_out_of_range_gets_exception_3(request_: Any) -> None:
    talk, _ = make()

    assert talk.code(request_) == 3
    assert talk.ask(ReadHoldingRegisters(229, 1)) == (0,)


def test_a_negative_value_out_of_range_gets_exception_3() -> None:
    talk, _ = make()

    assert talk.code(WriteRegisters(USER_1, (0x8000, 0xFFFF))) == 3  # -32768, allowed from -10000


def test_the_combined_request_writes_before_it_reads() -> None:
    talk, _ = make()

    assert talk.ask(ReadWriteRegisters(229, 1, 229, (4,))) == (4,)


def test_measured_values_are_those_of_the_motor() -> None:
    talk, unit = make()
    talk.ask(START)
    talk.wait(20.0)

    low, high = talk.ask(ReadHoldingRegisters(24, 2))
    assert low + (high << 16) == pytest.approx(unit.motor.current_a * 10, rel=0.02)
    assert talk.ask(ReadHoldingRegisters(59, 1)) == (1,)
    assert talk.ask(ReadHoldingRegisters(8, 1))[0] == pytest.approx(unit.motor.power_factor * 100, abs=1)


def test_every_parameter_of_the_table_can_be_read() -> None:
    talk, unit = make()
    for owner in {each.start: each for each in unit._map.owners.values()}.values():
        assert talk.code(ReadHoldingRegisters(owner.start, owner.words)) is None, owner
