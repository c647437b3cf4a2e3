"""The simulated SSW-07 as people at it, its supplies and its options make it behave."""

from __future__ import annotations

import pytest

from gateway.modbus.reads import ReadHoldingRegisters
from gateway.modbus.writes import WriteCoil, WriteRegister
from gateway.sim.core.power import MotorState
from tests.sim.ssw07_rig import RESET, START, STATUS, STOP, make, running, status


def test_with_the_option_running_stays_on_during_the_ramp_down() -> None:
    talk, _ = running(is_running_while_stopping=True)

    talk.ask(STOP)

    assert status(talk) & 0x81 == 0x81


def test_with_a_run_command_in_force_a_reset_starts_the_motor() -> None:
    talk, unit = running(keeps_run_command=True)
    unit.trip(5)
    talk.wait(10.0)

    talk.ask(RESET)

    assert unit.motor.is_turned_on
    assert unit.starts == [0.0]


def test_with_a_run_command_in_force_general_enable_starts_the_motor() -> None:
    talk, unit = running(keeps_run_command=True)
    talk.ask(WriteCoil(101, is_on=False))
    assert unit.motor.state is MotorState.COASTING
    talk.wait(10.0)

    talk.ask(WriteCoil(101, is_on=True))

    assert unit.motor.is_turned_on


def test_with_a_run_command_in_force_a_start_in_error_is_made_good_by_the_reset() -> None:
    talk, unit = make(keeps_run_command=True)
    unit.trip(5)
    talk.ask(START)
    assert not unit.motor.is_turned_on

    talk.ask(RESET)

    assert unit.motor.is_turned_on


def test_p220_at_0_or_1_switches_the_mode_at_once() -> None:
    talk, unit = make()

    talk.ask(WriteRegister(220, 0))
    assert not unit.is_remote
    talk.ask(WriteRegister(220, 1))
    assert unit.is_remote


def test_the_keypad_starts_and_stops_in_local_mode_only() -> None:
    _, unit = make()
    unit.keypad_start()
    assert not unit.motor.is_turned_on

    unit.set_remote(is_remote=False)
    unit.keypad_start()
    assert unit.motor.is_turned_on
    unit.keypad_stop()
    assert unit.motor.state is MotorState.RAMP_DOWN


def test_an_enable_input_that_opens_lets_the_motor_coast() -> None:
    talk, unit = running()
    unit.set_enable_input(is_on=False)

    assert unit.motor.state is MotorState.COASTING
    assert status(talk) & 0x0002 == 0
    assert talk.ask(ReadHoldingRegisters(6, 1)) == (12,)
    unit.set_enable_input(is_on=True)
    assert status(talk) & 0x0002


def test_without_mains_the_status_says_so_and_nothing_starts() -> None:
    talk, unit = running()
    unit.set_mains(is_present=False)
    talk.wait(10.0)

    talk.ask(START)

    assert status(talk) & 0x4000 == 0
    assert not unit.motor.is_turning


def test_without_control_supply_it_is_silent_until_it_has_started_up() -> None:
    talk, unit = running(settings={314: 20, 313: 1})
    unit.power_off()
    talk.wait(100.0)
    assert talk.pdu(STATUS) is None

    unit.power_on()
    talk.wait(1.0)
    assert talk.pdu(STATUS) is None
    talk.wait(1.1)

    assert status(talk) == 0x4102
    assert unit.trips == []


@pytest.mark.parametrize(("mode", "is_remote"), [(0, False), (1, True), (5, False), (6, True)])
def test_p220_decides_the_mode_after_switching_on(mode: int, is_remote: bool) -> None:
    _, unit = make(settings={220: mode})

    assert unit.is_remote is is_remote


def test_an_overload_is_shown_as_a_fault() -> None:
    talk, unit = running()
    unit.motor.load_pct = 160.0
    talk.wait(1200.0)

    assert unit.fault == 5
    assert talk.ask(ReadHoldingRegisters(6, 1)) == (2,)
    unit.reset_at_keypad()
    unit.motor.thermal_pct = 0.0
    talk.ask(START)
    talk.wait(10.0)
    unit.motor.load_pct = 400.0
    talk.wait(3.0)
    assert unit.fault == 66


def test_every_write_frame_is_stored_whether_obeyed_or_not() -> None:
    talk, unit = make()
    talk.ask(START)
    talk.code(WriteRegister(89, 0))
    talk.ask(STATUS)

    assert [write.pdu for write in unit.writes] == [START.encode(), WriteRegister(89, 0).encode()]
