"""What a hand at a simulated starter does, by words."""

from __future__ import annotations

from typing import Any

import pytest

from gateway.errors import UsageError
from gateway.families.profile.load import FAMILIES
from gateway.sim.controls import KNOBS, set_knob
from gateway.sim.core.unit import SimulatedUnit
from gateway.sim.factory import make_unit
from gateway.sim.sst.unit import Sst
from gateway.sim.ssw900.unit import Ssw900
from gateway.sim.weg.common import Commanded
from gateway.sim.weg.ssw06 import Ssw06
from tests.rules.acting import RAW_START
from tests.sim.wire import Talk


def make(family: str, **options: Any) -> SimulatedUnit:
    unit = make_unit(family, 1, **options)
    unit.advance(0.0)
    return unit


def running(family: str) -> SimulatedUnit:
    talk = Talk(make_unit(family, 1))
    talk.pdu(RAW_START[family])
    talk.wait(1.0)
    assert talk.unit.motor.is_turned_on
    return talk.unit


def has_fault(unit: SimulatedUnit) -> bool:
    return bool(unit.errors) if isinstance(unit, Sst) else isinstance(unit, Commanded) and unit.is_fault


@pytest.mark.parametrize(
    ("family", "setting", "code"),
    [
        ("ssw06", "", "E05"),
        ("ssw07", "E66", "E66"),
        ("ssw07", "e5", "E05"),
        ("ssw900", "F128", "F128"),
        ("ssw900", "7", "F007"),
        ("sst", "", "COIL12"),
        ("sst", "coil17", "COIL17"),
    ],
)
def test_a_starter_trips_with_the_code_that_is_asked_for_and_its_motor_coasts(
    family: str, setting: str, code: str
) -> None:
    unit = running(family)

    said = set_knob(unit, "trip", setting)

    assert said == f"tripped: {code}"
    assert unit.trips[-1].code == code
    assert has_fault(unit)
    assert not unit.motor.is_turned_on


@pytest.mark.parametrize("family", FAMILIES)
def test_a_fault_is_cleared_at_the_starter_itself(family: str) -> None:
    unit = make(family)
    set_knob(unit, "trip", "")

    set_knob(unit, "clear", "")

    assert not has_fault(unit)


def test_alarms_come_and_go_where_the_family_has_them() -> None:
    mill, fan = make("ssw900"), make("ssw06")
    assert isinstance(mill, Ssw900)
    assert isinstance(fan, Ssw06)

    assert set_knob(mill, "alarm", "A063") == "alarm A063"
    set_knob(fan, "alarm", "")
    assert (mill.alarms, fan.is_alarm) == ([63], True)

    set_knob(mill, "clear", "")
    set_knob(fan, "clear", "")
    assert (mill.alarms, fan.is_alarm) == ([], False)


@pytest.mark.parametrize("family", ["ssw06", "ssw07", "ssw900"])
def test_a_weg_starter_goes_local_and_back(family: str) -> None:
    unit = make(family)
    assert isinstance(unit, Commanded)

    set_knob(unit, "control", "local")
    is_local = not unit.is_remote
    set_knob(unit, "control", "remote")

    assert is_local
    assert unit.is_remote


def test_an_sst_goes_over_to_its_inputs_where_it_is_started_and_stopped_by_hand() -> None:
    unit = make("sst")
    assert isinstance(unit, Sst)

    set_knob(unit, "control", "local")
    assert unit.control == "parallel"
    set_knob(unit, "keypad", "start")
    assert unit.motor.is_turned_on
    set_knob(unit, "keypad", "stop")
    assert not unit.motor.is_turned_on
    set_knob(unit, "control", "remote")
    assert unit.control == "modbus"


def test_the_keypad_of_a_weg_starter_counts_in_local_control_only() -> None:
    unit = make("ssw07")

    set_knob(unit, "keypad", "start")
    assert not unit.motor.is_turned_on
    set_knob(unit, "control", "local")
    set_knob(unit, "keypad", "start")
    assert unit.motor.is_turned_on
    set_knob(unit, "keypad", "stop")
    assert not unit.motor.is_turned_on


@pytest.mark.parametrize("family", FAMILIES)
def test_both_supplies_can_be_switched(family: str) -> None:
    unit = make(family)

    set_knob(unit, "power", "off")
    assert not unit.is_powered
    set_knob(unit, "power", "on")
    set_knob(unit, "mains", "off")

    assert unit.is_powered
    assert not unit.motor.is_mains_present
    set_knob(unit, "mains", "on")
    assert unit.motor.is_mains_present


@pytest.mark.parametrize(
    ("family", "knob", "setting", "why"),
    [
        ("ssw07", "explode", "", "no knob 'explode'"),
        ("ssw07", "trip", "E100", "no fault 'E100'"),
        ("ssw07", "trip", "often", "no number 'often'"),
        ("ssw07", "trip", "0", "no number '0'"),
        ("sst", "trip", "COIL9", "COIL10 to COIL21"),
        ("sst", "alarm", "", "sst has no alarms"),
        ("ssw07", "alarm", "", "ssw07 has no alarms"),
        ("ssw900", "power", "maybe", "on or off"),
        ("ssw900", "control", "", "remote or local"),
    ],
)
def test_what_a_starter_does_not_have_is_refused_with_what_it_has(
    family: str, knob: str, setting: str, why: str
) -> None:
    unit = make(family)

    with pytest.raises(UsageError, match=why):
        set_knob(unit, knob, setting)

    assert unit.trips == []


def test_every_knob_is_named() -> None:
    by_hand = ("trip", "alarm", "clear", "control", "power", "mains", "keypad")
    motor = ("load", "friction", "wear", "thermal", "voltage", "phase")
    assert by_hand + motor == KNOBS
