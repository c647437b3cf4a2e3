"""Frames, registers and readings of the simulated SST; rules are named as in their list (ST-xx)."""

from __future__ import annotations

from typing import Any

import pytest

from gateway.modbus.reads import ReadCoils, ReadHoldingRegisters, ReadInputRegisters
from gateway.modbus.writes import WriteCoils, WriteRegister, WriteRegisters
from tests.sim.sst_rig import START, STOP, coil, initialise, make, ones, register, running


@pytest.mark.parametrize("request_", [ReadHoldingRegisters(0, 1), WriteCoils(0, (True,))])
def test_st_01_other_functions_get_exception_1(request_: Any) -> None:
    talk, _ = make()

    assert talk.code(request_) == 1


def test_st_02_coil_n_is_at_n_minus_1_and_register_n_at_n() -> None:
    talk, _ = make()

    assert ones(talk) == {5, 6, 26}
    assert register(talk, 0) == 330
    assert talk.code(ReadCoils(26, 1)) == 2
    assert talk.code(ReadCoils(20, 7)) == 2
    assert talk.code(ReadInputRegisters(42, 2)) == 2


def test_st_05_a_request_of_more_than_54_bytes_is_ignored() -> None:
    talk, _ = make()
    initialise(talk)
    talk.ask(coil(2))

    assert talk.pdu(WriteRegisters(20, (0,) * 23)) is None
    assert talk.pdu(WriteRegisters(20, (0,) * 22)) is not None


def test_st_06_an_answer_of_more_than_54_bytes_is_exception_4() -> None:
    talk, _ = make()

    assert len(talk.ask(ReadInputRegisters(0, 24))) == 24
    assert talk.code(ReadInputRegisters(0, 25)) == 4


@pytest.mark.parametrize("number", [0, 3, 7, 29])
def test_read_only_registers_are_refused_and_leave_the_motor_alone(number: int) -> None:
    talk, unit = running()

    assert talk.code(WriteRegister(number, 1)) == 2
    assert unit.motor.is_turned_on


def test_a_read_only_register_is_refused_in_configuration_mode_too() -> None:
    talk, _ = make()
    talk.ask(coil(2))

    assert talk.code(WriteRegister(12, 1)) == 2


def test_st_11_only_what_differs_is_written_to_flash() -> None:
    talk, unit = make()
    initialise(talk)
    initialise(talk, {32: register(talk, 32)})
    assert unit.flash_writes == 0

    initialise(talk, {32: 25})

    assert unit.flash_writes == 1
    assert register(talk, 32) == 25


def test_st_13_only_the_low_byte_is_stored_and_checked() -> None:
    talk, _ = make()
    talk.ask(coil(2))

    talk.ask(WriteRegister(36, 0x0130))
    talk.ask(WriteRegister(4, 0x0130))

    assert register(talk, 36) == 0x30
    assert register(talk, 4) == 0x0130
    assert talk.code(WriteRegister(36, 0x30FF)) == 3
    assert talk.code(WriteRegisters(30, (20, 99))) == 3


@pytest.mark.parametrize(
    ("model", "allowed", "refused"),
    [("SST330i-M", 47, 48), ("SST130i-75-M", 75, 47), ("SST130i-140-M-ES", 140, 141)],
)
def test_st_13_ranges_differ_by_model(model: str, allowed: int, refused: int) -> None:
    talk, _ = make(model=model)
    talk.ask(coil(2))

    assert talk.code(WriteRegister(30, allowed)) is None
    assert talk.code(WriteRegister(30, refused)) == 3


def test_coils_that_only_report_cannot_be_written() -> None:
    talk, _ = make()

    assert talk.code(coil(5)) == 2
    assert talk.code(coil(26)) == 2


def test_st_20_registers_0_to_42_can_be_read_the_unused_21_too() -> None:
    talk, _ = make()

    assert len(talk.ask(ReadInputRegisters(0, 24))) + len(talk.ask(ReadInputRegisters(24, 19))) == 43
    assert register(talk, 21) == 0


def test_st_21_the_heatsink_temperature_is_a_signed_low_byte() -> None:
    talk, unit = make()
    unit.motor.heatsink_c = -1.0

    assert register(talk, 13) == 0x00FF


def test_st_22_register_19_shows_what_the_motor_does() -> None:
    talk, _ = make()
    seen = [register(talk, 19)]
    for request, wait_s in ((START, 0.5), (None, 5.0), (STOP, 0.5), (None, 5.0)):
        if request is not None:
            talk.ask(request)
        talk.wait(wait_s)
        seen.append(register(talk, 19))

    assert seen == [0, 1, 2, 3, 0]


def test_st_24_a_single_phase_model_shows_the_higher_stator_current() -> None:
    (three, three_unit), (single, single_unit) = running(), running(model="SST130i-75-M")

    assert register(three, 12) == pytest.approx(three_unit.motor.current_a, abs=1)
    assert register(single, 12) == pytest.approx(single_unit.motor.current_a * 1.2, abs=1)


def test_st_25_old_firmware_does_not_have_the_name() -> None:
    talk, _ = make(firmware="4.03")
    assert talk.code(ReadInputRegisters(22, 8)) == 2

    talk, _ = make(firmware="4.04")
    words = talk.ask(ReadInputRegisters(22, 8))
    assert b"".join(each.to_bytes(2, "big") for each in words) == b"SST330i-M".ljust(16, b"\0")


def test_versions_are_in_low_and_high_bytes() -> None:
    talk, _ = make(firmware="4.21")

    assert talk.ask(ReadInputRegisters(1, 3)) == (0x0106, 0x0204, 0x0001)


def test_errors_are_reset_by_themselves_after_register_40() -> None:
    talk, unit = make(settings={40: 2})
    unit.trip(12)
    talk.wait(30.0)
    assert talk.ask(ReadInputRegisters(15, 2)) == (30, 1)

    talk.wait(91.0)
    assert ones(talk) == {5, 6, 26}
    assert talk.ask(ReadInputRegisters(15, 2)) == (0, 0)


def test_protections_of_the_motor_set_their_coils() -> None:
    talk, unit = running()
    unit.motor.load_pct = 400.0
    talk.wait(2.0)
    assert unit.errors == {12}

    talk, unit = running()
    unit.motor.load_pct = 160.0
    talk.wait(1200.0)
    assert unit.errors == {13}
