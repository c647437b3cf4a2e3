"""Faults, timeout, counters and settings of the simulated SSW900; rules as in their list (S9-xx)."""

from __future__ import annotations

import pytest

from gateway.modbus.device_id import ReadDeviceIdentification
from gateway.modbus.reads import ReadHoldingRegisters
from gateway.modbus.timing import Framing, LineTiming
from gateway.modbus.writes import WriteRegister
from gateway.sim.core.power import MotorState
from gateway.sim.core.unit import Trip
from tests.sim.ssw900_rig import WORD, make, read, running, status

TO_RAMP_S = 0.7  # time before start, initial test


def test_s9_17_mode_0_does_nothing() -> None:
    talk, unit = running(settings={734: 50, 740: 0})
    talk.wait(100.0)

    assert unit.trips == []


def test_s9_17_mode_1_trips_f128_and_the_motor_coasts() -> None:
    talk, unit = running(settings={734: 150, 740: 1})
    talk.wait(6.0)

    assert unit.trips == [Trip(15.0, "F128")]
    assert unit.motor.state is MotorState.COASTING
    assert (read(talk, 90), read(talk, 735)) == (128, 2)
    talk.ask(WriteRegister(WORD, 0x0092))
    assert (read(talk, 90), read(talk, 735)) == (0, 1)


@pytest.mark.parametrize(
    ("action", "state"),
    [
        (0, MotorState.BYPASS),
        (1, MotorState.RAMP_DOWN),
        (2, MotorState.COASTING),
        (3, MotorState.BYPASS),
        (4, MotorState.BYPASS),
    ],
)
def test_s9_17_mode_2_raises_a128_and_does_what_c8_2_5_2_says(action: int, state: MotorState) -> None:
    talk, unit = running(settings={734: 150, 740: 2, 741: action})
    talk.wait(6.0)

    assert unit.trips == [Trip(15.0, "A128")]
    assert unit.alarms == [128]
    assert unit.motor.state is state
    assert unit.is_remote is (action != 3)
    assert status(talk) & 0x4000 == 0  # gone with the first telegram


def test_s9_17_action_4_changes_to_remote() -> None:
    talk, unit = make(settings={734: 150, 740: 2, 741: 4})
    talk.ask(WriteRegister(WORD, 0x0002))
    assert not unit.is_remote

    talk.wait(16.0)

    assert unit.is_remote


def test_s9_18_the_time_counts_from_the_first_valid_telegram() -> None:
    talk, unit = make(settings={734: 50, 740: 1})
    talk.wait(100.0)
    assert unit.trips == []

    status(talk)
    talk.wait(5.1)
    assert unit.trips == [Trip(105.0, "F128")]


@pytest.mark.parametrize("action", [1, 2, 3, 4])
@pytest.mark.parametrize("source", [0, 5])  # C3.3: the HMI's keys, slot 2
def test_s9_19_the_a128_action_has_no_effect_when_the_slot_is_not_the_source(
    source: int, action: int
) -> None:
    is_remote = action == 3
    talk, unit = make(settings={220: int(is_remote), 229: source, 230: source, 734: 150, 740: 2, 741: action})
    if source:
        talk.ask(WriteRegister(686, 0x0003))
    else:
        unit.keypad_start()
    assert unit.is_started
    status(talk)
    talk.wait(16.0)

    assert [trip.code for trip in unit.trips] == ["A128"]
    assert unit.motor.is_turned_on
    assert unit.is_remote is is_remote


def test_s9_20_the_counters_count_telegrams() -> None:
    talk, unit = make()
    for _ in range(3):
        status(talk)
    unit.note_reception_error(is_crc=True, byte_count=8)
    unit.note_reception_error(is_crc=False, byte_count=5)

    assert talk.ask(ReadHoldingRegisters(736, 4)) == (4, 3, 1, 5)
    unit.received = 0x1FFFF
    assert read(talk, 736) == 0


def test_s9_22_outputs_follow_their_words_only_when_set_to_communication() -> None:
    talk, _ = make(settings={275: 12, 251: 9})

    talk.ask(WriteRegister(695, 7))
    talk.ask(WriteRegister(696, 1023))

    assert read(talk, 678) == 1
    assert talk.ask(ReadHoldingRegisters(673, 4)) == (10000, 20000, 10000, 1023)


def test_s9_22_an_output_with_another_function_stays() -> None:
    talk, _ = make()

    talk.ask(WriteRegister(696, 1023))

    assert read(talk, 676) == 0


def test_s9_25_faults_and_alarms_are_numbered() -> None:
    talk, unit = make()
    unit.set_alarm(5, is_on=True)
    unit.set_alarm(66, is_on=True)
    unit.trip(66)

    assert talk.ask(ReadHoldingRegisters(90, 6)) == (66, 5, 66, 0, 0, 0)
    assert status(talk) & 0xC000 == 0xC000
    assert read(talk, 679) == 2
    unit.set_alarm(5, is_on=False)
    unit.reset_at_keypad()
    assert talk.ask(ReadHoldingRegisters(90, 6)) == (0, 66, 0, 0, 0, 0)


def test_an_overload_is_f005() -> None:
    talk, unit = running()
    unit.motor.load_pct = 160.0
    talk.wait(1200.0)

    assert unit.fault == 5


def test_a_blocked_rotor_is_f066() -> None:
    talk, unit = running()
    unit.motor.load_pct = 400.0
    talk.wait(2.0)

    assert unit.fault == 66


def test_general_disable_is_state_13() -> None:
    talk, unit = make()
    unit.set_enable_input(is_on=False)

    assert read(talk, 679) == 13


def test_s9_01_it_says_who_it_is() -> None:
    talk, _ = make()

    assert talk.ask(ReadDeviceIdentification()).objects == {0: "WEG", 1: "SSW900", 2: "V1.20"}


def test_the_hmi_keys_command_when_c3_names_them() -> None:
    talk, unit = make(settings={230: 0})

    unit.keypad_start()
    assert unit.is_started
    talk.wait(TO_RAMP_S + 0.1)
    unit.keypad_stop()
    assert unit.motor.state is MotorState.RAMP_DOWN


def test_a_local_key_switches_the_mode() -> None:
    talk, unit = make()
    unit.set_remote(is_remote=False)

    assert status(talk) & 0x0100 == 0
    assert read(talk, WORD) == 0x0002


def test_speed_framing_and_address_are_parameters() -> None:
    talk, unit = make()
    timing = LineTiming(57600, Framing.parse("8N1"))
    unit.join(timing)
    assert talk.ask(ReadHoldingRegisters(731, 2)) == (1, 3)
    assert unit.listens_to(timing)

    talk.ask(WriteRegister(732, 0))
    talk.ask(WriteRegister(731, 9))

    assert not unit.listens_to(timing)
    assert unit.address == 9


def test_a_speed_that_c8_2_3_does_not_know_is_taken_as_given() -> None:
    _, unit = make()
    timing = LineTiming(115200, Framing.parse("8N1"))
    unit.join(timing)

    assert unit.listens_to(timing)


def test_the_model_is_shown_by_its_range_of_currents() -> None:
    talk, _ = make(model="412A")

    assert read(talk, 294) == 3
