"""Initialisation, commands and errors of the simulated SST; rules are named as in their list (ST-xx)."""

from __future__ import annotations

from typing import Any

import pytest

from gateway.modbus.writes import WriteRegister, WriteRegisters
from gateway.sim.core.power import MotorState
from gateway.sim.core.unit import Trip
from tests.sim.sst_rig import START, STOP, coil, initialise, make, ones, register, running


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


def test_st_12_coil_5_becomes_1_after_the_flash_write() -> None:
    talk, _ = make(flash_s=0.5)
    talk.ask(coil(2))
    talk.ask(coil(2, is_on=False))
    talk.wait(0.4)
    assert 5 not in ones(talk)

    talk.wait(0.2)
    assert 5 in ones(talk)


def test_while_the_flash_is_written_every_write_gets_exception_6_and_reads_are_answered() -> None:
    talk, _ = make(flash_s=0.5)
    talk.ask(coil(2))
    talk.ask(coil(2, is_on=False))

    assert [talk.code(each) for each in (START, coil(2), WriteRegister(30, 20))] == [6, 6, 6]
    assert 5 not in ones(talk)
    talk.wait(0.5)
    assert 5 in ones(talk)
    assert talk.code(START) is None


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


@pytest.mark.parametrize("after_s", [1, 2])
def test_st_17_a_starter_with_a_short_register_42_starts_up_once_and_waits_for_a_command(
    after_s: int,
) -> None:
    talk, unit = make(settings={42: after_s})
    register(talk, 42)
    talk.wait(1000.0)

    assert [trip.code for trip in unit.trips] == ["R42"]
    initialise(talk, {42: 0})
    talk.wait(10.0)
    assert (register(talk, 42), len(unit.trips)) == (0, 1)


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
