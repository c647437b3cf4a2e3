"""A simulated motor that loses a phase, browns out or is hot: currents, voltages, the family's own fault."""

from __future__ import annotations

import math

import pytest

from gateway.errors import UsageError
from gateway.families.profile.load import FAMILIES
from gateway.modbus.reads import ReadCoils, ReadHoldingRegisters, ReadInputRegisters
from gateway.sim.controls import set_knob
from gateway.sim.core.meter import Meter
from gateway.sim.core.motor import PHASES, Motor, start_curve
from gateway.sim.core.power import MotorData, MotorState, MotorTrip
from gateway.sim.factory import make_unit
from tests.rules.acting import RAW_START
from tests.sim.wire import Talk

OVERLOAD, PHASE_LOSS, UNDERVOLTAGE = range(3)
CODES = {
    "ssw06": ("E05", "E74", "E02"),
    "ssw07": ("E05", "E74", "E02"),
    "ssw900": ("F005", "F074", "F002"),
    "sst": ("COIL13", "COIL17", "COIL14"),
}
STATUS = {"ssw06": 5001, "ssw07": 5001, "ssw900": 680}


def started(family: str, *, wait_s: float = 20.0) -> Talk:
    talk = Talk(make_unit(family, 1))
    talk.pdu(RAW_START[family])
    talk.wait(wait_s)
    assert talk.unit.motor.is_turned_on
    return talk


def running(**changes: float) -> Motor:
    motor = Motor(MotorData(rated_current_a=100.0, **changes))
    motor.start()
    motor.step(20.0)
    assert motor.state is MotorState.BYPASS
    return motor


def shown_fault(talk: Talk, family: str) -> int:
    """Return the number of the fault as it is read over the line; 0 where the family gives none."""
    if family == "sst":
        coils = talk.ask(ReadCoils(9, 12))
        return next((coil for coil, is_set in enumerate(coils, 10) if is_set), 0)
    if family == "ssw06":
        return int(talk.ask(ReadHoldingRegisters(5001, 1))[0] >> 15)
    return int(talk.ask(ReadHoldingRegisters(14 if family == "ssw07" else 90, 1))[0])


@pytest.mark.parametrize("phase", PHASES)
def test_a_lost_phase_carries_nothing_and_the_others_more_until_it_trips(phase: str) -> None:
    motor = running()
    meter = Meter(motor)
    before_a = motor.current_a
    motor.lost_phase = PHASES.index(phase)
    motor.step(1.0)

    currents_a = meter.phase_currents_a
    assert currents_a[motor.lost_phase] == pytest.approx(0.0)
    others = [each for place, each in enumerate(currents_a) if place != motor.lost_phase]
    assert others == pytest.approx([math.sqrt(3) * before_a] * 2, rel=0.02)
    assert sum(currents_a) / 3 == pytest.approx(meter.current_a)
    volts = meter.line_voltages_v
    assert sorted(volts) == pytest.approx([200.0, 200.0, 400.0], rel=0.02)
    assert meter.line_voltage_v == pytest.approx(sum(volts) / 3)
    motor.step(1.9)
    assert motor.trip is None
    motor.step(0.2)
    assert motor.trip is MotorTrip.PHASE_LOSS
    assert motor.state is MotorState.COASTING


def test_a_phase_that_comes_back_in_time_trips_nothing() -> None:
    motor = running()
    for _ in range(10):
        motor.lost_phase = 1
        motor.step(2.0)
        motor.lost_phase = None
        motor.step(1.0)

    assert motor.trip is None


def test_a_motor_does_not_accelerate_on_two_phases() -> None:
    motor = Motor(MotorData())
    motor.lost_phase = 0
    motor.start()
    motor.step(2.9)

    assert (motor.state, motor.trip) == (MotorState.RAMP_UP, None)
    assert motor.speed == pytest.approx(0.0)
    motor.step(0.2)
    assert motor.trip is MotorTrip.PHASE_LOSS


def test_a_dip_during_a_start_makes_it_longer_by_what_it_takes_from_the_torque() -> None:
    data = MotorData(ramp_up_s=8.0)
    motor = Motor(data)
    motor.start()
    motor.step(2.0)
    motor.set_line_voltage(90.0, for_s=3.0)
    motor.step(20.0)

    assert motor.line_voltage_pct == pytest.approx(100.0)
    assert motor.start_s == pytest.approx(8.0 + 3.0 * (1 - 0.81), abs=0.02)
    assert motor.start_s > start_curve(data).duration_s


def test_a_low_voltage_shows_in_the_voltage_and_takes_more_current_for_the_load() -> None:
    motor = running(load_pct=80.0)
    meter = Meter(motor)
    before_a = motor.current_a
    motor.set_line_voltage(90.0)

    assert meter.line_voltage_v == pytest.approx(360.0, rel=0.02)
    assert before_a * 1.05 < motor.current_a < before_a / 0.9


@pytest.mark.parametrize(
    ("percent", "for_s", "trip"), [(79.0, 1.5, True), (79.0, 0.8, False), (85.0, 60.0, False)]
)
def test_only_a_deep_and_long_dip_trips(percent: float, for_s: float, trip: bool) -> None:
    motor = running()
    motor.set_line_voltage(percent, for_s=for_s)
    motor.step(100.0)

    assert (motor.trip is MotorTrip.UNDERVOLTAGE) is trip
    assert motor.line_voltage_pct == pytest.approx(100.0)


def test_a_dip_at_rest_ends_too_and_trips_nothing() -> None:
    motor = Motor(MotorData())
    motor.set_line_voltage(50.0, for_s=5.0)
    motor.step(4.9)
    assert motor.line_voltage_pct == pytest.approx(50.0)
    motor.step(0.2)

    assert (motor.line_voltage_pct, motor.trip) == (pytest.approx(100.0), None)


def test_the_thermal_level_rises_and_cools_with_its_time_constants() -> None:
    data = MotorData(load_pct=100.0, heating_s=600.0, cooling_s=1800.0, ramp_up_s=0.1)
    motor = Motor(data)
    motor.start()
    motor.step(1.0)
    motor.thermal_pct = 0.0
    motor.step(600.0)
    risen = 100 / 1.15**2 * (1 - math.exp(-1))
    assert motor.thermal_pct == pytest.approx(risen, rel=0.01)
    motor.cut()
    motor.step(1800.0)

    assert motor.thermal_pct == pytest.approx(risen * math.exp(-1), rel=0.01)


@pytest.mark.parametrize("family", FAMILIES)
def test_a_lost_phase_is_the_familys_own_fault(family: str) -> None:
    talk = started(family)
    assert set_knob(talk.unit, "phase", "s") == "phase S is lost"
    talk.wait(5.0)

    assert [trip.code for trip in talk.unit.trips] == [CODES[family][PHASE_LOSS]]
    assert shown_fault(talk, family) == {"ssw06": 1, "ssw07": 74, "ssw900": 74, "sst": 17}[family]
    assert not talk.unit.motor.is_turned_on


@pytest.mark.parametrize("family", FAMILIES)
def test_a_deep_dip_is_the_familys_own_fault(family: str) -> None:
    talk = started(family)
    assert set_knob(talk.unit, "voltage", "70 2.5") == "line voltage 70 % for 2.5 s"
    talk.wait(5.0)

    assert [trip.code for trip in talk.unit.trips] == [CODES[family][UNDERVOLTAGE]]
    assert shown_fault(talk, family) == {"ssw06": 1, "ssw07": 2, "ssw900": 2, "sst": 14}[family]


@pytest.mark.parametrize("family", FAMILIES)
def test_a_hot_motor_trips_on_overload_and_cools_down_afterwards(family: str) -> None:
    talk = started(family)
    set_knob(talk.unit, "load", "130")
    assert set_knob(talk.unit, "thermal", "99") == "thermal level 99 %"
    talk.wait(120.0)

    assert [trip.code for trip in talk.unit.trips] == [CODES[family][OVERLOAD]]
    level_pct = talk.unit.motor.thermal_pct
    talk.wait(1800.0)
    assert talk.unit.motor.thermal_pct == pytest.approx(level_pct * math.exp(-1), rel=0.02)


def test_the_thermal_level_is_read_where_the_family_gives_it() -> None:
    readers = {"ssw07": (50, 2.5), "ssw900": (50, 10)}  # an SSW-07 trips at 250 %
    for family, (register, factor) in readers.items():
        talk = started(family)
        set_knob(talk.unit, "thermal", "60")

        (word,) = talk.ask(ReadHoldingRegisters(register, 1))

        assert word == pytest.approx(60 * factor, abs=factor)


@pytest.mark.parametrize("family", ["ssw06", "ssw07"])
def test_the_bit_of_the_supply_needs_all_three_phases(family: str) -> None:
    talk = Talk(make_unit(family, 1))
    bits = []
    for setting in ("on", "r", "on"):
        set_knob(talk.unit, "phase", setting)
        bits.append(talk.ask(ReadHoldingRegisters(STATUS[family], 1))[0] >> 14 & 1)

    assert bits == [1, 0, 1]


@pytest.mark.parametrize("family", FAMILIES)
def test_worn_motors_start_more_slowly_as_read_over_the_line(family: str) -> None:
    def start_s(friction: str) -> float:
        talk = Talk(make_unit(family, 1))
        set_knob(talk.unit, "friction", friction)
        talk.pdu(RAW_START[family])
        begun_s = talk.now_s
        while not is_at_full_voltage(talk, family):
            talk.wait(0.02)
        return talk.now_s - begun_s

    ramp_s = make_unit(family, 1).motor.data.ramp_up_s
    assert start_s("50") - start_s("0") == pytest.approx(0.5 * ramp_s, abs=0.05)


def is_at_full_voltage(talk: Talk, family: str) -> bool:
    if family == "sst":
        return bool(talk.ask(ReadInputRegisters(19, 1))[0] == 2)
    return bool(talk.ask(ReadHoldingRegisters(STATUS[family], 1))[0] >> 5 & 1)


@pytest.mark.parametrize("family", FAMILIES)
def test_each_start_wears_by_what_the_knob_says(family: str) -> None:
    talk = Talk(make_unit(family, 1))
    assert set_knob(talk.unit, "wear", "2.5") == "friction grows by 2.5 % with each start"
    talk.pdu(RAW_START[family])
    talk.wait(30.0)

    assert talk.unit.motor.friction_pct == pytest.approx(2.5)
    set_knob(talk.unit, "load", "50")
    assert talk.unit.motor.friction_pct == pytest.approx(2.5)


@pytest.mark.parametrize(
    ("knob", "setting", "why"),
    [
        ("phase", "x", "r or s or t or on"),
        ("voltage", "", "a number from 0 to 120"),
        ("voltage", "500", "a number from 0 to 120"),
        ("voltage", "80 long", "in s"),
        ("thermal", "-3", "a number from 0 to 100"),
        ("load", "much", "a number from 0 to 1000"),
        ("friction", "1e3", "a number from 0 to 1000"),
        ("wear", "101", "a number from 0 to 100"),
    ],
)
def test_what_no_motor_can_have_is_refused_with_what_it_can(knob: str, setting: str, why: str) -> None:
    unit = make_unit("ssw07", 1)

    with pytest.raises(UsageError, match=why):
        set_knob(unit, knob, setting)
