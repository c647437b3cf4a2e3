"""The simulated SST follows its manual; rules are named as in their list (ST-xx)."""

from __future__ import annotations

from typing import Any

import pytest

from gateway.modbus.reads import ReadCoils, ReadHoldingRegisters, ReadInputRegisters
from gateway.modbus.writes import WriteCoil, WriteCoils, WriteRegister, WriteRegisters
from gateway.sim.factory import make_unit
from gateway.sim.power import MotorState
from gateway.sim.sst import Sst
from gateway.sim.unit import Trip
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


def test_st_07_a_starter_that_is_not_initialised_is_so_by_coil_2() -> None:
    talk, _ = make(is_configured=False)
    assert ones(talk) == {6}

    initialise(talk)

    assert ones(talk) == {5, 6, 26}


def test_st_07_after_power_up_the_initialisation_is_due_again() -> None:
    talk, unit = make()
    unit.power_off()
    unit.power_on()
    talk.wait(3.0)

    assert ones(talk) == {6}


def test_st_08_setting_coil_2_stops_the_motor() -> None:
    talk, unit = running()

    talk.ask(coil(2))

    assert unit.motor.state is MotorState.RAMP_DOWN
    assert ones(talk) == {2, 6}


def test_st_09_a_start_while_coil_5_is_0_gets_exception_2() -> None:
    talk, unit = make(is_configured=False)

    assert talk.code(START) == 2
    assert unit.starts == []
    assert unit.start_frames == [0.0]


@pytest.mark.parametrize("number", [4, 30, 42])
def test_st_10_a_setting_written_outside_configuration_mode_stops_the_motor(number: int) -> None:
    talk, unit = running()

    assert talk.code(WriteRegister(number, 20)) == 2
    assert unit.motor.state is MotorState.RAMP_DOWN
    assert 1 not in ones(talk)


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


def test_st_12_coil_5_becomes_1_after_the_flash_write() -> None:
    talk, _ = make(flash_s=0.5)
    talk.ask(coil(2))
    talk.ask(coil(2, is_on=False))
    talk.wait(0.4)
    assert 5 not in ones(talk)

    talk.wait(0.2)
    assert 5 in ones(talk)


def test_entering_configuration_again_before_the_flash_write_postpones_it() -> None:
    talk, _ = make(flash_s=0.5)
    talk.ask(coil(2))
    talk.ask(coil(2, is_on=False))
    talk.ask(coil(2))
    talk.wait(5.0)

    assert 5 not in ones(talk)


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


@pytest.mark.parametrize(("control", "number"), [("usb", 7), ("parallel", 8)])
@pytest.mark.parametrize("request_", [START, WriteRegister(30, 20), WriteRegisters(30, (20,))])
def test_st_14_while_another_controls_every_write_gets_exception_1(
    control: Any, number: int, request_: Any
) -> None:
    talk, unit = make()
    unit.set_control(control)

    assert talk.code(request_) == 1
    assert number in ones(talk)


def test_st_15_after_a_stop_through_usb_the_motor_waits_for_a_start_through_modbus() -> None:
    talk, unit = running()
    unit.set_control("usb")
    unit.local_stop()
    talk.wait(10.0)
    unit.set_control("modbus")
    talk.wait(10.0)
    assert not unit.motor.is_turning

    talk.ask(START)
    assert unit.motor.is_turned_on


def test_st_15_after_a_start_through_usb_it_runs_on() -> None:
    talk, unit = make()
    unit.local_start()
    assert not unit.motor.is_turned_on

    unit.set_control("usb")
    unit.local_start()
    unit.set_control("modbus")
    unit.local_stop()
    talk.wait(10.0)

    assert register(talk, 19) == 2


def test_st_16_without_mains_coil_26_is_0_and_a_start_does_nothing() -> None:
    talk, unit = make()
    unit.set_mains(is_present=False)

    assert talk.code(START) is None
    assert 26 not in ones(talk)
    assert unit.starts == []


def test_st_17_register_41_stops_the_motor_when_no_command_comes() -> None:
    talk, unit = make()
    initialise(talk, {41: 12})
    talk.ask(START)
    talk.wait(11.0)
    register(talk, 0)
    talk.wait(11.0)
    assert unit.motor.is_turned_on

    talk.wait(1.5)

    assert [trip.code for trip in unit.trips] == ["R41"]
    assert not unit.motor.is_turned_on
    assert 1 not in ones(talk)


def test_st_17_register_42_restarts_the_starter_when_no_command_comes() -> None:
    talk, unit = running(settings={42: 20})
    talk.wait(11.0)

    assert unit.trips == [Trip(20.0, "R42")]
    assert talk.pdu(START) is None
    talk.wait(3.0)
    assert ones(talk) == {6}
    assert unit.motor.state is MotorState.COASTING or not unit.motor.is_turning


def test_st_17_at_0_nothing_is_supervised() -> None:
    talk, unit = running()
    talk.wait(10_000.0)

    assert unit.trips == []


def test_st_18_and_st_19_errors_are_named_by_coils_and_reset_by_coil_3() -> None:
    talk, unit = running()
    unit.trip(17)
    assert {9, 17} <= ones(talk)
    assert unit.motor.state is MotorState.COASTING
    talk.ask(START)
    assert not unit.motor.is_turned_on

    talk.ask(coil(3, is_on=False))
    assert 9 in ones(talk)
    talk.ask(coil(3))

    assert ones(talk) == {5, 6, 26}
    talk.wait(10.0)
    assert not unit.motor.is_turning


def test_only_coils_10_to_21_name_an_error() -> None:
    _, unit = make()

    with pytest.raises(ValueError, match="coil 9"):
        unit.trip(9)


def test_st_19_coil_4_restarts_the_whole_starter() -> None:
    talk, unit = running()
    talk.ask(coil(4, is_on=False))
    assert unit.motor.is_turned_on

    assert talk.code(coil(4)) is None

    assert talk.pdu(START) is None
    talk.wait(2.1)
    assert ones(talk) == {6}


def test_coils_that_only_tell_cannot_be_written() -> None:
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


def test_st_22_register_19_tells_what_the_motor_does() -> None:
    talk, _ = make()
    seen = [register(talk, 19)]
    for request, wait_s in ((START, 0.5), (None, 5.0), (STOP, 0.5), (None, 5.0)):
        if request is not None:
            talk.ask(request)
        talk.wait(wait_s)
        seen.append(register(talk, 19))

    assert seen == [0, 1, 2, 3, 0]


def test_st_23_a_single_phase_model_starts_only_once_its_capacitor_is_discharged() -> None:
    talk, unit = make(model="SST130i-75-M")
    talk.ask(START)
    talk.wait(3.0)
    talk.ask(STOP)
    talk.wait(2.0)
    assert register(talk, 20) > 10

    talk.ask(START)
    assert not unit.motor.is_turned_on
    talk.wait(10.0)

    assert unit.motor.is_turned_on
    assert len(unit.starts) == 2


def test_st_23_a_stop_calls_the_waiting_start_off() -> None:
    talk, unit = make(model="SST130i-140-M")
    talk.ask(START)
    talk.wait(3.0)
    talk.ask(STOP)
    talk.wait(1.0)
    talk.ask(START)
    talk.ask(STOP)
    talk.wait(30.0)

    assert not unit.motor.is_turning


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


def test_an_overlong_wait_for_the_capacitor_is_none() -> None:
    _, unit = make(model="SST130i-75-M")

    assert unit.capacitor_v == 0.0


def test_leaving_a_mode_that_was_not_entered_does_nothing() -> None:
    talk, _ = make(is_configured=False)

    talk.ask(coil(2, is_on=False))
    talk.wait(5.0)

    assert ones(talk) == {6}


def test_a_second_start_is_no_second_start() -> None:
    talk, unit = running()

    talk.ask(START)

    assert unit.starts == unit.start_frames == [0.0]
