"""Commands and modes of the simulated SSW-06; rules are named as in their list (S6-xx)."""

from __future__ import annotations

import pytest

from gateway.modbus.reads import ReadHoldingRegisters
from gateway.modbus.writes import WriteCoil, WriteRegister
from gateway.sim.core.power import MotorState
from tests.sim.ssw06_rig import START, STATUS, VB03, make, running, status


def test_s6_01_vb00_always_reads_15() -> None:
    talk, _ = make()

    assert talk.ask(ReadHoldingRegisters(5000, 1)) == (15,)
    assert talk.code(WriteRegister(5000, 1)) == 3


def test_s6_02_a_value_bit_without_its_mask_bit_does_nothing() -> None:
    talk, unit = make()

    talk.ask(WriteRegister(VB03, 0x0003))

    assert not unit.motor.is_turned_on
    assert unit.start_frames == []


def test_s6_02_0303h_runs_0100h_stops_and_0200h_disables() -> None:
    talk, unit = make()
    talk.ask(WriteRegister(VB03, 0x0303))
    talk.wait(10.0)
    assert unit.motor.is_at_full_voltage

    talk.ask(WriteRegister(VB03, 0x0100))
    assert unit.motor.state is MotorState.RAMP_DOWN

    talk.wait(10.0)
    talk.ask(START)
    talk.ask(WriteRegister(VB03, 0x0200))
    assert unit.motor.state is MotorState.COASTING
    assert status(talk) & 0x0002 == 0


def test_s6_03_bits_without_mask_keep_their_state() -> None:
    talk, unit = make()
    talk.ask(WriteRegister(VB03, 0x0808))

    talk.ask(START)

    assert unit.is_enabled
    assert unit.is_remote
    assert unit.is_reverse
    assert talk.ask(ReadHoldingRegisters(VB03, 1)) == (0x001B,)


def test_s6_04_coils_are_the_value_bits_without_any_mask() -> None:
    talk, unit = make()

    talk.ask(WriteCoil(100, is_on=True))
    assert unit.motor.state is MotorState.RAMP_UP
    talk.ask(WriteCoil(100, is_on=False))
    assert unit.motor.state is MotorState.RAMP_DOWN


def test_s6_05_a_reset_needs_no_source_but_an_error() -> None:
    talk, unit = make(settings={220: 2, 230: 0})
    talk.ask(WriteRegister(VB03, 0x8080))
    assert unit.is_listening

    unit.trip(3)
    talk.ask(WriteRegister(VB03, 0x8000))
    talk.pdu(WriteRegister(VB03, 0x8080))

    assert not unit.is_fault


@pytest.mark.parametrize("number", [28, 29, 30])
def test_s6_06_communication_faults_cannot_be_reset_through_the_network(number: int) -> None:
    talk, unit = make()
    unit.trip(number)

    talk.ask(WriteRegister(VB03, 0x8080))

    assert unit.fault == number


def test_s6_07_a_command_not_set_to_serial_is_answered_but_not_executed() -> None:
    talk, unit = make(settings={230: 0})
    assert talk.code(START) is None
    assert not unit.motor.is_turned_on

    talk, unit = make(settings={230: 0}, is_command_refused=True)
    assert talk.code(START) == 3


def test_s6_08_a_run_command_during_p630_looks_like_success_but_is_ignored() -> None:
    talk, unit = running(settings={630: 5})
    talk.ask(WriteRegister(VB03, 0x0100))
    talk.wait(6.0)

    assert talk.code(START) is None
    assert not unit.motor.is_turned_on


@pytest.mark.parametrize("answers", [False, True])
def test_s6_09_a_reset_restarts_the_device_which_is_silent_meanwhile(*, answers: bool) -> None:
    talk, unit = running(answers_before_restart=answers, restart_s=3.0)
    unit.trip(3)

    assert (talk.pdu(WriteRegister(VB03, 0x8080)) is not None) is answers
    talk.wait(2.9)
    assert talk.pdu(STATUS) is None
    talk.wait(0.2)
    assert status(talk) == 0x4102  # ready again, and not running


def test_s6_09_whether_the_reset_is_answered_is_left_to_chance() -> None:
    answered = set()
    for seed in range(20):
        talk, unit = make(seed=seed)
        unit.trip(3)
        answered.add(talk.pdu(WriteRegister(VB03, 0x8080)) is not None)

    assert answered == {True, False}


def test_a_run_bit_in_the_word_of_the_reset_is_lost_in_the_restart() -> None:
    talk, unit = make()
    unit.trip(3)

    talk.pdu(WriteRegister(VB03, 0x8181))
    talk.wait(10.0)

    assert not unit.motor.is_turning
    assert unit.starts == []


def test_s6_10_a_change_of_p202_leads_into_an_adjusting_mode() -> None:
    talk, unit = running()

    talk.ask(WriteRegister(202, 3))

    assert unit.motor.state is MotorState.COASTING
    assert talk.ask(ReadHoldingRegisters(5006, 1)) == (2,)
    talk.wait(10.0)
    talk.ask(START)
    assert not unit.motor.is_turned_on
    assert talk.ask(ReadHoldingRegisters(202, 1)) == (3,)


def test_s6_10_writing_p202_unchanged_does_nothing() -> None:
    talk, _ = make()

    talk.ask(WriteRegister(202, 0))

    assert talk.ask(ReadHoldingRegisters(5006, 1)) == (0,)


def test_s6_10_p204_at_5_loads_the_factory_settings_and_adjusts() -> None:
    talk, unit = make()

    talk.ask(WriteRegister(204, 5))

    assert talk.ask(ReadHoldingRegisters(5006, 1)) == (1,)
    assert talk.ask(ReadHoldingRegisters(220, 1)) == (2,)
    assert unit.address == 1


def test_s6_10_writing_vb07_leaves_the_mode_by_a_restart() -> None:
    talk, unit = make()
    talk.ask(WriteRegister(202, 3))

    talk.pdu(WriteRegister(5007, 2))
    assert talk.pdu(STATUS) is None
    talk.wait(4.0)

    assert talk.ask(ReadHoldingRegisters(5006, 1)) == (0,)
    talk.ask(START)
    assert unit.motor.is_turned_on


def test_s6_11_vb07_is_accepted_only_while_vb06_shows_that_mode() -> None:
    talk, _ = make()
    talk.ask(WriteRegister(202, 3))

    assert talk.code(WriteRegister(5007, 1)) is None
    assert talk.ask(ReadHoldingRegisters(5006, 1)) == (2,)

    talk, _ = make(is_command_refused=True)
    assert talk.code(WriteRegister(5007, 1)) == 3


def test_s6_20_running_goes_to_0_as_soon_as_a_stop_is_received() -> None:
    talk, _ = running()

    talk.ask(WriteRegister(VB03, 0x0100))

    assert status(talk) & 0x0081 == 0x0080


def test_an_alarm_is_bit_6() -> None:
    talk, unit = make()
    unit.is_alarm = True

    assert status(talk) & 0x0040


def test_reversal_and_direction_bits() -> None:
    talk, unit = running()

    talk.ask(WriteRegister(VB03, 0x0808))
    assert status(talk) & 0x0C00 == 0x0400
    talk.wait(5.0)
    assert status(talk) & 0x0C00 == 0x0800
    assert unit.motor.is_turned_on
