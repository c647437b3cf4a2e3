"""Registers, outputs and E28 of the simulated SSW-07; rules as in their list (S7-xx)."""

from __future__ import annotations

from typing import Any

import pytest

from gateway.modbus.device_id import ReadDeviceIdentification
from gateway.modbus.reads import ReadCoils, ReadHoldingRegisters, ReadInputRegisters
from gateway.modbus.timing import Framing, LineTiming
from gateway.modbus.writes import WriteCoil, WriteRegister, WriteRegisters
from gateway.sim.core.power import MotorState
from gateway.sim.core.unit import Trip
from gateway.sim.factory import make_unit
from gateway.sim.weg.command_sources import OUTPUT_BY_SERIAL
from tests.sim.ssw07_rig import STATUS, make, running, status


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


def test_readings_are_those_of_the_motor() -> None:
    talk, unit = running(model="SSW-07 85.0A")

    percent, current = talk.ask(ReadHoldingRegisters(2, 2))

    assert current == pytest.approx(unit.motor.current_a * 10, rel=0.02)
    assert percent == pytest.approx(unit.motor.current_pct * 10, rel=0.02)
    assert talk.ask(ReadHoldingRegisters(6, 1)) == (5,)
    assert talk.ask(ReadHoldingRegisters(295, 1)) == (85,)


@pytest.mark.parametrize(("family", "each_s"), [("ssw06", 0.010), ("ssw07", 0.020)])
def test_fc16_takes_its_time_for_each_register_and_no_less(family: str, each_s: float) -> None:
    unit = make_unit(family, 1)

    for count in (1, 2, 5):
        pdu = WriteRegisters(313, (0,) * count).encode()
        assert unit.response_delay_s(pdu) == pytest.approx(count * each_s)
        assert unit.longest_response_s(pdu) == pytest.approx(count * each_s)
