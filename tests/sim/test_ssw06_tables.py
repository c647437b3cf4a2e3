"""Registers, outputs and E28 of the simulated SSW-06; rules are named as in their list (S6-xx)."""

from __future__ import annotations

from typing import Any

import pytest

from gateway.modbus.device_id import ReadDeviceIdentification
from gateway.modbus.reads import ReadCoils, ReadHoldingRegisters
from gateway.modbus.writes import MaskWriteRegister, WriteRegister, WriteRegisters
from gateway.sim.core.power import MotorState
from gateway.sim.core.unit import Trip
from gateway.sim.weg.command_sources import OUTPUT_BY_SERIAL
from tests.sim.ssw06_rig import STATUS, VB03, make, running, status


def test_s6_12_relays_follow_vb08_only_where_set_to_serial() -> None:
    talk, unit = make(settings={278: OUTPUT_BY_SERIAL, 279: OUTPUT_BY_SERIAL})

    talk.ask(WriteRegister(5008, 7))

    assert unit.relays == 6


def test_s6_13_analog_outputs_follow_vb09_and_vb10_with_their_gains() -> None:
    talk, unit = make(settings={251: OUTPUT_BY_SERIAL, 252: 500})

    talk.ask(WriteRegisters(5009, (16383, 16383)))

    assert unit.analog_pct == pytest.approx((50.0, 0.0))
    assert talk.code(WriteRegister(5009, 16384)) == 3


def test_s6_14_and_s6_16_e28_clears_the_outputs_and_goes_when_telegrams_return() -> None:
    talk, unit = make(settings={251: OUTPUT_BY_SERIAL, 277: OUTPUT_BY_SERIAL, 314: 3})
    talk.ask(WriteRegisters(5008, (1, 100, 0)))
    talk.wait(3.1)

    assert unit.trips == [Trip(3.0, "E28")]
    assert talk.ask(ReadHoldingRegisters(5008, 3)) == (0, 0, 0)
    assert not unit.is_silence_shown


@pytest.mark.parametrize("action", [0, 4])
def test_s6_15_p313_at_0_or_4_does_nothing(action: int) -> None:
    talk, unit = running(settings={313: action, 314: 20})
    talk.wait(30.0)

    assert unit.trips
    assert unit.motor.is_turned_on


@pytest.mark.parametrize(("action", "state"), [(1, MotorState.RAMP_DOWN), (2, MotorState.COASTING)])
def test_s6_15_p313_at_1_or_2_stops_the_motor(action: int, state: MotorState) -> None:
    talk, unit = running(settings={313: action, 314: 20})
    talk.wait(11.0)

    assert unit.motor.state is state


def test_s6_15_p313_at_3_goes_local() -> None:
    talk, unit = running(settings={313: 3, 314: 20})
    talk.wait(11.0)

    assert not unit.is_remote


def test_s6_15_p313_at_5_is_a_fatal_error_that_stays() -> None:
    talk, unit = running(settings={313: 5, 314: 20})
    talk.wait(30.0)

    assert status(talk) & 0x8000
    assert unit.is_silence_shown
    talk.ask(WriteRegister(VB03, 0x8080))
    assert unit.fault == 28
    unit.reset_at_keypad()
    assert unit.fault == 0


def test_c_13_with_the_option_a_fatal_e28_can_be_reset_through_the_network() -> None:
    talk, unit = running(settings={313: 5, 314: 20}, is_e28_resettable=True)
    talk.wait(30.0)

    talk.pdu(WriteRegister(VB03, 0x8080))

    assert unit.fault == 0


def test_s6_17_p000_is_taken_but_not_stored() -> None:
    talk, _ = make()

    talk.ask(WriteRegister(0, 5))

    assert talk.ask(ReadHoldingRegisters(0, 1)) == (0,)


@pytest.mark.parametrize("number", [200, 215])
def test_s6_18_p200_and_p215_cannot_be_reached(number: int) -> None:
    talk, _ = make()

    assert talk.code(ReadHoldingRegisters(number, 1)) == 2
    assert talk.code(WriteRegister(number, 0)) == 2


def test_s6_19_from_820_a_on_currents_are_divided_by_ten() -> None:
    big_talk, big = running(model="820")
    small_talk, small = running(model="670")

    assert big_talk.ask(ReadHoldingRegisters(3, 1))[0] == pytest.approx(big.motor.current_a, rel=0.02)
    assert small_talk.ask(ReadHoldingRegisters(3, 1))[0] == pytest.approx(
        small.motor.current_a * 10, rel=0.02
    )
    assert big_talk.ask(ReadHoldingRegisters(2, 1))[0] == pytest.approx(big.motor.current_pct * 10, rel=0.02)


def test_s6_21_answers_take_5_to_10_ms_and_10_ms_for_each_written_register() -> None:
    _, unit = make()
    delays = [unit.response_delay_s(STATUS.encode()) for _ in range(100)]

    assert min(delays) >= 0.005
    assert max(delays) <= 0.010
    assert unit.longest_response_s(WriteRegisters(5008, (0, 0)).encode()) == pytest.approx(0.020)


def test_s6_21_other_functions_get_exception_1() -> None:
    talk, _ = make()

    assert talk.code(MaskWriteRegister(VB03, 0, 0)) == 1


def test_s6_22_it_says_who_it_is() -> None:
    talk, _ = make(model="SSW-06 820.0A")

    assert talk.ask(ReadDeviceIdentification()).objects == {0: "WEG", 1: "SSW-06 820.0A", 2: "V1.60"}


@pytest.mark.parametrize(
    ("request_", "code"),
    [
        (WriteRegister(220, 11), 3),
        (WriteRegister(5006, 0), 3),
        (WriteRegister(89, 0), 2),
        (ReadHoldingRegisters(5002, 1), 2),
        (ReadCoils(16, 1), 2),
    ],
)
def test_s6_23_what_is_out_of_range_or_does_not_exist_is_refused(request_: Any, code: int) -> None:
    talk, _ = make()

    assert talk.code(request_) == code
