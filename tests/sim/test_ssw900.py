"""Commands of the simulated SSW900; rules are named as in their list (S9-xx)."""

from __future__ import annotations

from gateway.modbus.reads import ReadHoldingRegisters
from gateway.modbus.writes import MaskWriteRegister, WriteRegister
from gateway.sim.core.power import MotorState
from tests.sim.ssw900_rig import START, WORD, make, read, running, status

STOP = WriteRegister(WORD, 0x0012)


def test_as_delivered_the_word_is_0012h_and_the_slot_commands_in_remote() -> None:
    talk, _ = make()

    assert read(talk, WORD) == 0x0012
    assert status(talk) == 0x0102
    assert read(talk, 232) == 9  # slot 1, remote
    assert read(talk, 679) == 0


def test_a_start_goes_through_delay_and_initial_test_to_the_ramp_and_the_bypass() -> None:
    talk, unit = make()
    talk.ask(START)
    assert (status(talk), read(talk, 679)) == (0x1102, 11)

    talk.wait(0.6)
    assert (status(talk), read(talk, 679)) == (0x010A, 1)
    talk.wait(0.2)
    assert (status(talk), read(talk, 679)) == (0x0113, 3)
    talk.wait(10.0)
    assert (status(talk), read(talk, 679)) == (0x0163, 5)
    assert unit.starts == [0.0]


def test_a_stop_ramps_down_and_then_waits_out_the_time_after_a_stop() -> None:
    talk, _ = running()
    talk.ask(STOP)
    assert (status(talk), read(talk, 679)) == (0x0182, 7)

    talk.wait(5.0)
    assert (status(talk), read(talk, 679)) == (0x2102, 12)
    talk.wait(2.0)
    assert (status(talk), read(talk, 679)) == (0x0102, 0)


def test_a_stop_before_the_ramp_calls_the_start_off() -> None:
    talk, unit = make()
    talk.ask(START)
    talk.wait(0.3)
    talk.ask(STOP)
    talk.wait(5.0)

    assert unit.motor.starts == 0


def test_a_start_during_the_time_after_a_stop_is_ignored() -> None:
    talk, unit = running()
    talk.ask(STOP)
    talk.wait(4.5)

    talk.ask(START)
    talk.wait(5.0)

    assert not unit.motor.is_turning
    assert len(unit.starts) == 1


def test_writing_the_word_again_while_running_is_no_second_start() -> None:
    talk, unit = running()

    talk.ask(START)

    assert unit.starts == unit.start_frames == [0.0]


def test_s9_07_without_a_mask_a_bare_reset_stops_and_disables() -> None:
    talk, unit = running()

    talk.ask(WriteRegister(WORD, 0x0080))

    assert not unit.motor.is_turned_on
    assert not unit.is_remote


def test_s9_07_reset_acts_on_0_to_1_and_only_on_a_fault() -> None:
    talk, unit = make()
    talk.ask(WriteRegister(WORD, 0x0092))
    unit.trip(66)

    talk.ask(WriteRegister(WORD, 0x0092))
    assert unit.is_fault
    talk.ask(WriteRegister(WORD, 0x0012))
    talk.ask(WriteRegister(WORD, 0x0092))
    assert not unit.is_fault


def test_s9_07_reserved_bits_do_nothing() -> None:
    talk, unit = make()

    talk.ask(WriteRegister(WORD, 0xFF72))

    assert not unit.is_started
    assert read(talk, WORD) == 0x0012


def test_s9_07_jog_and_direction() -> None:
    talk, unit = make()

    talk.ask(WriteRegister(WORD, 0x001E))

    assert status(talk) & 0x0804 == 0x0804
    assert read(talk, 679) == 10
    talk.ask(WriteRegister(WORD, 0x001A))
    assert unit.motor.state is MotorState.COASTING


def test_a_reversal_shows_in_status_and_state() -> None:
    talk, unit = running()

    talk.ask(WriteRegister(WORD, 0x001B))

    assert status(talk) & 0x0400
    assert read(talk, 679) == 9
    talk.wait(10.0)
    assert unit.is_reverse


def test_s9_08_run_and_jog_of_an_inactive_source_are_cleared() -> None:
    talk, unit = make(settings={230: 1})  # remote: digital inputs

    talk.ask(WriteRegister(WORD, 0x0017))

    assert read(talk, WORD) == 0x0012
    assert not unit.is_started
    assert unit.start_frames == [0.0]
    assert unit.starts == []


def test_s9_08_a_start_bit_for_the_other_slot_is_hidden() -> None:
    talk, unit = make(slot=1)

    talk.ask(WriteRegister(686, 0x0013))

    assert read(talk, 686) == 0x0012
    assert not unit.is_started


def test_s9_06_and_s9_21_with_the_accessory_in_slot_2_its_own_word_commands() -> None:
    talk, unit = make(slot=2)
    assert talk.ask(ReadHoldingRegisters(335, 2)) == (0, 2)
    assert read(talk, 232) == 11

    talk.ask(WriteRegister(685, 0x0013))
    assert not unit.is_started
    talk.ask(WriteRegister(686, 0x0013))
    assert unit.is_started


def test_w_12_the_source_follows_menu_c3() -> None:
    talk, unit = make()
    talk.ask(WriteRegister(220, 0))
    assert not unit.is_remote
    assert read(talk, 232) == 0

    talk.ask(START)
    assert not unit.is_started
    talk.ask(WriteRegister(229, 4))
    talk.ask(START)
    assert unit.is_started


def test_bit_4_switches_the_mode_only_when_c3_1_names_the_slot() -> None:
    talk, unit = make(settings={220: 3})
    talk.ask(WriteRegister(WORD, 0x0002))
    assert unit.is_remote

    talk, unit = make()
    talk.ask(WriteRegister(WORD, 0x0002))
    assert not unit.is_remote


def test_a_reset_needs_no_command_source() -> None:
    talk, unit = make(settings={230: 1})
    unit.trip(5)

    talk.ask(WriteRegister(WORD, 0x0092))

    assert not unit.is_fault


def test_a_fault_calls_a_start_off_and_clears_the_run_bit() -> None:
    talk, unit = make()
    talk.ask(START)
    unit.trip(5)

    assert read(talk, WORD) == 0x0012
    talk.ask(WriteRegister(WORD, 0x0092))
    talk.wait(5.0)
    assert unit.motor.starts == 0


def test_with_a_run_command_in_force_a_reset_starts_the_motor() -> None:
    talk, unit = running(keeps_run_command=True)
    unit.trip(5)
    talk.wait(20.0)
    assert read(talk, WORD) == 0x0013

    talk.ask(WriteRegister(WORD, 0x0093))
    talk.wait(1.0)

    assert unit.motor.is_turned_on


def test_the_mask_write_changes_single_bits_of_the_word() -> None:
    talk, unit = make()

    talk.ask(MaskWriteRegister(WORD, 0xFFFE, 0x0001))

    assert unit.is_started
    assert unit.is_enabled


def test_a_word_that_goes_local_and_stops_stops_the_motor() -> None:
    talk, unit = running()

    talk.ask(WriteRegister(WORD, 0x0002))

    assert unit.motor.state is MotorState.RAMP_DOWN


def test_with_a_braking_method_a_stop_brakes_for_its_time() -> None:
    talk, unit = running(settings={500: 3, 501: 5})
    talk.wait(20.0)

    talk.ask(WriteRegister(WORD, 0x0012))
    assert (status(talk) & 0x0281, read(talk, 679)) == (0x0200, 8)
    talk.wait(5.1)
    assert status(talk) & 0x0281 == 0
    assert not unit.motor.is_turning
    talk.ask(WriteRegister(500, 0))
    talk.wait(10.0)
    talk.ask(START)
    talk.wait(20.0)
    talk.ask(WriteRegister(WORD, 0x0012))
    assert status(talk) & 0x0281 == 0x0080
