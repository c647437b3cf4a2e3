"""Commands of the simulated SSW-07; rules are named as in their list (S7-xx, W-xx)."""

from __future__ import annotations

import pytest

from gateway.modbus.reads import ReadCoils, ReadHoldingRegisters
from gateway.modbus.writes import WriteCoil, WriteCoils, WriteRegister
from gateway.sim.core.power import MotorState
from gateway.sim.core.unit import Trip
from tests.sim.ssw07_rig import RESET, START, STOP, make, running, status


def test_a_start_by_coil_works_as_delivered() -> None:
    talk, unit = make()
    assert status(talk) == 0x4102  # enabled, remote, supplied

    talk.ask(START)
    talk.wait(1.0)

    assert status(talk) == 0x410B | 0x10  # running, accelerating, held at the current limit
    talk.wait(10.0)
    assert status(talk) == 0x5123  # full voltage, bypass
    assert unit.starts == [0.0]


def test_a_stop_by_coil_ramps_down() -> None:
    talk, _ = running()

    talk.ask(STOP)

    assert status(talk) == 0x4182  # decelerating; running is 0 at once
    talk.wait(5.0)
    assert status(talk) == 0x4102


def test_s7_01_a_bare_reset_word_also_stops_disables_and_goes_local() -> None:
    for local_source in (0, 2):
        talk, unit = running(settings={229: local_source})

        talk.ask(WriteRegister(5003, 0x0080))

        assert not unit.is_remote
        assert unit.motor.state is MotorState.COASTING


def test_s7_01_a_word_that_goes_local_and_only_stops_ramps_down() -> None:
    talk, unit = running()

    talk.ask(WriteRegister(5003, 0x0002))

    assert unit.motor.state is MotorState.RAMP_DOWN


def test_s7_01_a_word_that_goes_local_and_runs_leaves_the_motor_running() -> None:
    talk, unit = running()

    talk.ask(WriteRegister(5003, 0x0003))

    assert unit.motor.state is MotorState.BYPASS
    assert not unit.is_in_control


def test_s7_01_the_word_starts_when_it_also_keeps_remote_and_enable() -> None:
    talk, unit = make()

    talk.ask(WriteRegister(5003, 0x0013))

    assert unit.motor.is_turned_on
    assert talk.ask(ReadHoldingRegisters(5003, 1)) == (0x0013,)


def test_b_10_the_manuals_own_start_word_takes_the_control_away_from_the_network() -> None:
    talk, unit = make()

    talk.ask(WriteRegister(5003, 0x0003))

    assert not unit.motor.is_turned_on
    assert not unit.is_remote
    assert unit.start_frames == [0.0]
    assert unit.starts == []


def test_s7_02_a_coil_sets_one_command_bit_without_touching_the_others() -> None:
    talk, unit = running()

    talk.ask(WriteCoil(103, is_on=False))
    talk.ask(WriteCoil(107, is_on=False))

    assert unit.motor.is_turned_on
    assert unit.is_enabled
    assert talk.ask(ReadCoils(100, 8)) == (True, True, False, False, True, False, False, False)


def test_s7_03_before_v1_40_there_is_no_jog_and_no_direction() -> None:
    talk, unit = make(firmware="1.30")

    talk.ask(WriteCoils(102, (True, True)))

    assert unit.motor.state is MotorState.STOPPED
    assert not unit.is_reverse
    assert status(talk) & 0x0C04 == 0


def test_s7_03_from_v1_40_on_the_motor_jogs_and_reverses() -> None:
    talk, _ = make(firmware="1.40")

    talk.ask(WriteCoil(103, is_on=True))
    talk.ask(WriteCoil(102, is_on=True))

    assert status(talk) & 0x0804 == 0x0804
    talk.ask(WriteCoil(102, is_on=False))
    assert status(talk) & 0x0004 == 0


def test_a_change_of_direction_while_running_stops_and_starts_the_other_way() -> None:
    talk, unit = running()

    talk.ask(WriteCoil(103, is_on=True))
    assert status(talk) & 0x0C80 == 0x0480  # reversing, decelerating
    talk.wait(5.0)

    assert status(talk) & 0x0C08 == 0x0808  # reverse, accelerating
    assert unit.starts == [0.0]


def test_a_stop_during_the_reversal_ends_it() -> None:
    talk, unit = running()

    talk.ask(WriteCoil(103, is_on=True))
    talk.ask(STOP)
    talk.wait(30.0)

    assert not unit.motor.is_turning


def test_s7_04_bits_6_and_13_are_never_set() -> None:
    talk, unit = running()
    unit.trip(5)

    assert status(talk) & 0x2040 == 0


def test_s7_05_a_reset_works_without_any_command_source_and_only_in_error() -> None:
    talk, unit = make(settings={220: 2, 230: 0})
    unit.trip(5)
    assert status(talk) & 0x8000

    talk.ask(RESET)

    assert status(talk) & 0x8000 == 0


@pytest.mark.parametrize("number", [28, 29, 30])
def test_s7_05_communication_faults_cannot_be_reset_through_the_network(number: int) -> None:
    talk, unit = make()
    unit.trip(number)

    talk.ask(RESET)
    assert status(talk) & 0x8000

    unit.reset_at_keypad()
    assert status(talk) & 0x8000 == 0


def test_w_13_a_reset_bit_left_at_1_does_not_reset_again() -> None:
    talk, unit = make()
    talk.ask(RESET)
    unit.trip(5)

    talk.ask(RESET)
    assert unit.is_fault

    talk.ask(WriteCoil(107, is_on=False))
    talk.ask(RESET)
    assert not unit.is_fault


def test_a_fault_stops_the_motor_and_a_reset_does_not_start_it_again() -> None:
    talk, unit = running()
    unit.trip(5)
    talk.wait(10.0)

    talk.ask(RESET)

    assert not unit.motor.is_turning
    assert talk.ask(ReadHoldingRegisters(14, 1)) == (5,)
    assert unit.trips == [Trip(10.0, "E05")]


@pytest.mark.parametrize("settings", [{230: 0}, {220: 0}, {230: 1}])
def test_s7_06_a_command_that_is_not_set_up_for_serial_is_answered_but_not_executed(
    settings: dict[int, int],
) -> None:
    talk, unit = make(settings=settings)

    assert talk.code(START) is None

    assert not unit.motor.is_turned_on
    assert unit.starts == []
    assert unit.start_frames == [0.0]


def test_s7_06_with_the_option_it_gets_exception_3() -> None:
    talk, unit = make(settings={230: 0}, is_command_refused=True)

    assert talk.code(START) == 3
    assert not unit.motor.is_turned_on


def test_w_12_local_and_remote_switch_only_with_p220_set_to_serial() -> None:
    talk, unit = make(settings={220: 3})
    talk.ask(WriteCoil(104, is_on=False))
    assert unit.is_remote

    talk, unit = make(settings={220: 6})
    talk.ask(WriteCoil(104, is_on=False))
    assert not unit.is_remote


def test_s7_07_a_run_command_during_p630_is_ignored_without_error() -> None:
    talk, unit = running(settings={630: 5})
    talk.ask(STOP)
    talk.wait(4.5)

    assert talk.code(START) is None
    assert not unit.motor.is_turned_on
    assert talk.ask(ReadHoldingRegisters(6, 1)) == (11,)

    talk.wait(5.0)
    talk.ask(START)
    assert unit.motor.is_turned_on
    assert len(unit.starts) == 2
    assert len(unit.start_frames) == 3


def test_a_general_disable_shows_in_bit_1_though_its_word_gives_the_control_away() -> None:
    talk, unit = running(settings={229: 0})

    talk.ask(WriteRegister(5003, 0x0000))
    assert status(talk) & 0x0102 == 0
    talk.ask(WriteCoil(104, is_on=True))
    talk.ask(WriteCoil(101, is_on=True))
    assert status(talk) & 0x0102 == 0x0102
    assert not unit.motor.is_turned_on


def test_the_keypad_enables_again_what_the_line_has_disabled() -> None:
    talk, unit = make(settings={229: 0})
    talk.ask(WriteRegister(5003, 0x0000))

    unit.keypad_start()

    assert unit.motor.is_turned_on
    assert status(talk) & 0x0002


def test_a_general_disable_by_p313_shows_until_telegrams_come_again() -> None:
    talk, unit = make(settings={313: 2, 314: 5, 230: 0})
    unit.keypad_start()
    talk.wait(6.0)

    assert not unit.motor.is_turned_on
    assert not unit.is_enabled
    assert status(talk) & 0x0002
