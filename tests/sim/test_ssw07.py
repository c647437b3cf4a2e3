"""The simulated SSW-07 follows its manual; rules are named as in their list (S7-xx, W-xx)."""

from __future__ import annotations

from typing import Any

import pytest

from gateway.modbus.identify import ReadDeviceIdentification
from gateway.modbus.reads import ReadCoils, ReadHoldingRegisters, ReadInputRegisters
from gateway.modbus.timing import Framing, LineTiming
from gateway.modbus.writes import WriteCoil, WriteCoils, WriteRegister, WriteRegisters
from gateway.sim.factory import make_unit
from gateway.sim.power import MotorState
from gateway.sim.ssw07 import Ssw07
from gateway.sim.supervised import OUTPUT_BY_SERIAL
from gateway.sim.unit import Trip
from tests.sim.wire import Talk

START = WriteCoil(100, is_on=True)
STOP = WriteCoil(100, is_on=False)
RESET = WriteCoil(107, is_on=True)
STATUS = ReadHoldingRegisters(5001, 1)


def make(**options: Any) -> tuple[Talk, Ssw07]:
    unit = make_unit("ssw07", 1, **options)
    assert isinstance(unit, Ssw07)
    return Talk(unit), unit


def running(**options: Any) -> tuple[Talk, Ssw07]:
    talk, unit = make(**options)
    talk.ask(START)
    talk.wait(10.0)
    return talk, unit


def status(talk: Talk) -> int:
    return int(talk.ask(STATUS)[0])


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


def test_with_the_option_running_stays_on_during_the_ramp_down() -> None:
    talk, _ = running(is_running_while_stopping=True)

    talk.ask(STOP)

    assert status(talk) & 0x81 == 0x81


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


def test_with_a_kept_run_command_a_reset_starts_the_motor() -> None:
    talk, unit = running(keeps_run_command=True)
    unit.trip(5)
    talk.wait(10.0)

    talk.ask(RESET)

    assert unit.motor.is_turned_on
    assert unit.starts == [0.0]


def test_with_a_kept_run_command_general_enable_starts_the_motor() -> None:
    talk, unit = running(keeps_run_command=True)
    talk.ask(WriteCoil(101, is_on=False))
    assert unit.motor.state is MotorState.COASTING
    talk.wait(10.0)

    talk.ask(WriteCoil(101, is_on=True))

    assert unit.motor.is_turned_on


def test_with_a_kept_run_command_a_start_in_error_is_made_good_by_the_reset() -> None:
    talk, unit = make(keeps_run_command=True)
    unit.trip(5)
    talk.ask(START)
    assert not unit.motor.is_turned_on

    talk.ask(RESET)

    assert unit.motor.is_turned_on


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


def test_s7_08_relays_follow_vb08_only_where_their_function_is_serial() -> None:
    talk, unit = make(settings={277: OUTPUT_BY_SERIAL})

    talk.ask(WriteRegister(5008, 3))

    assert unit.relays == 1
    assert talk.ask(ReadHoldingRegisters(5008, 1)) == (1,)


def test_s7_09_without_telegrams_e28_is_shown_outputs_drop_and_it_goes_when_they_return() -> None:
    talk, unit = make(settings={277: OUTPUT_BY_SERIAL, 313: 0})
    talk.ask(WriteRegister(5008, 1))
    talk.ask(WriteRegister(314, 5))
    talk.wait(4.9)
    assert unit.trips == []

    talk.wait(0.2)

    assert unit.trips == [Trip(5.0, "E28")]
    assert unit.is_silence_shown
    assert unit.relays == 0
    assert status(talk) & 0x8000 == 0
    assert not unit.is_silence_shown


def test_s7_09_every_valid_telegram_restarts_the_count() -> None:
    talk, unit = make(settings={314: 5})
    for _ in range(10):
        talk.wait(4.0)
        status(talk)

    assert unit.trips == []


def test_s7_09_p314_at_0_supervises_nothing() -> None:
    talk, unit = running(settings={314: 20})
    talk.ask(WriteRegister(314, 0))
    talk.wait(1000.0)

    assert unit.trips == []
    assert unit.motor.is_turned_on


def test_s7_10_p313_at_1_stops_by_ramp() -> None:
    talk, unit = running(settings={313: 1, 314: 20})
    talk.wait(11.0)

    assert unit.motor.state is MotorState.RAMP_DOWN


def test_s7_10_p313_at_1_does_nothing_when_serial_does_not_control() -> None:
    talk, unit = make(settings={313: 1, 314: 20, 230: 0})
    unit.keypad_start()
    talk.wait(21.0)

    assert unit.trips == [Trip(20.0, "E28")]
    assert unit.motor.is_turned_on


def test_s7_10_p313_at_2_lets_the_motor_coast() -> None:
    talk, unit = running(settings={313: 2, 314: 20})
    talk.wait(11.0)

    assert unit.motor.state is MotorState.COASTING
    assert not unit.is_enabled


def test_s7_10_p313_at_3_goes_local_if_serial_switches_the_mode() -> None:
    talk, unit = running(settings={313: 3, 314: 20})
    talk.wait(11.0)
    assert not unit.is_remote
    assert unit.motor.is_turned_on

    talk, unit = running(settings={313: 3, 314: 20, 220: 1})
    talk.wait(11.0)
    assert unit.is_remote


def test_s7_11_p000_is_taken_but_not_stored_and_p200_and_p215_cannot_be_reached() -> None:
    talk, _ = make()

    talk.ask(WriteRegister(0, 5))

    assert talk.ask(ReadHoldingRegisters(0, 1)) == (0,)
    assert talk.code(ReadHoldingRegisters(200, 1)) == 2
    assert talk.code(WriteRegister(215, 0)) == 2


def test_s7_12_other_functions_get_exception_1() -> None:
    talk, _ = make()

    assert talk.code(ReadInputRegisters(2, 1)) == 1


def test_s7_12_answers_take_5_to_20_ms_and_20_ms_for_each_written_register() -> None:
    _, unit = make()
    delays = [unit.response_delay_s(STATUS.encode()) for _ in range(200)]
    write = WriteRegisters(313, (0, 0, 0)).encode()

    assert 0.005 <= min(delays) < 0.007
    assert 0.018 < max(delays) <= 0.020
    assert unit.longest_response_s(write) == pytest.approx(0.060)


def test_s7_13_it_says_who_it_is() -> None:
    talk, _ = make(model="SSW-07 45.0A")

    reply = talk.ask(ReadDeviceIdentification())

    assert reply.objects == {0: "WEG", 1: "SSW-07 45.0A", 2: "V1.40"}


def test_s7_13_an_ssw_08_may_say_so() -> None:
    talk, _ = make(model="SSW-08 17A")

    assert talk.ask(ReadDeviceIdentification()).objects[1] == "SSW-08 17.0A"


def test_s6_22_one_object_can_be_asked_for_and_other_read_codes_cannot() -> None:
    talk, _ = make()

    assert talk.ask(ReadDeviceIdentification(4, 2)).objects == {2: "V1.40"}
    assert talk.code(ReadDeviceIdentification(4, 9)) == 2
    assert talk.code(ReadDeviceIdentification(2, 0)) == 3
    assert list(talk.ask(ReadDeviceIdentification(1, 1)).objects) == [1, 2]
    assert list(talk.ask(ReadDeviceIdentification(1, 9)).objects) == [0, 1, 2]


@pytest.mark.parametrize(
    ("request_", "code"),
    [
        (WriteRegister(313, 4), 3),  # out of range
        (WriteRegister(3, 0), 3),  # read-only
        (WriteRegister(5001, 0), 3),
        (WriteRegister(630, 0), 3),
        (WriteCoil(0, is_on=True), 3),
        (WriteRegister(89, 0), 2),  # no such parameter
        (WriteCoil(50, is_on=True), 2),
        (ReadHoldingRegisters(89, 1), 2),
        (ReadHoldingRegisters(3, 3), 2),
        (ReadHoldingRegisters(5000, 1), 2),  # the SSW-07 has no VB00
        (ReadCoils(15, 2), 2),
    ],
)
def test_s7_14_what_is_out_of_range_or_does_not_exist_is_refused(request_: Any, code: int) -> None:
    talk, _ = make()

    assert talk.code(request_) == code


def test_a_refused_write_of_several_registers_changes_nothing() -> None:
    talk, _ = make()

    assert talk.code(WriteRegisters(313, (2, 2000))) == 3
    assert talk.ask(ReadHoldingRegisters(313, 2)) == (1, 0)


def test_p308_changes_the_address_and_p312_the_speed_it_listens_to() -> None:
    talk, unit = make()
    timing = LineTiming(19200, Framing.parse("8E1"))
    unit.join(timing)
    assert unit.listens_to(timing)
    assert talk.ask(ReadHoldingRegisters(312, 1)) == (6,)

    talk.ask(WriteRegister(308, 9))
    talk.ask(WriteRegister(312, 1))

    assert unit.address == 9
    assert not unit.listens_to(timing)
    assert unit.listens_to(LineTiming(9600, Framing.parse("8N2")))


def test_a_speed_that_p312_does_not_know_is_taken_as_given() -> None:
    _, unit = make()
    timing = LineTiming(115200, Framing.parse("8N1"))
    unit.join(timing)

    assert unit.listens_to(timing)


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


def test_readings_are_those_of_the_motor() -> None:
    talk, unit = running(model="SSW-07 85.0A")

    percent, current = talk.ask(ReadHoldingRegisters(2, 2))

    assert current == pytest.approx(unit.motor.current_a * 10, rel=0.02)
    assert percent == pytest.approx(unit.motor.current_pct * 10, rel=0.02)
    assert talk.ask(ReadHoldingRegisters(6, 1)) == (5,)
    assert talk.ask(ReadHoldingRegisters(295, 1)) == (85,)


def test_every_write_frame_is_kept_whether_obeyed_or_not() -> None:
    talk, unit = make()
    talk.ask(START)
    talk.code(WriteRegister(89, 0))
    talk.ask(STATUS)

    assert [write.pdu for write in unit.writes] == [START.encode(), WriteRegister(89, 0).encode()]
