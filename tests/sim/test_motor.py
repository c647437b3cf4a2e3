"""The simulated motor: its states, and what a start lasts and draws."""

from __future__ import annotations

import math

import pytest

from gateway.sim.core.motor import Motor
from gateway.sim.core.power import MotorData, MotorState


def standing(**changes: float) -> Motor:
    return Motor(MotorData(**{"rated_current_a": 100.0, "load_pct": 70.0, "ramp_up_s": 8.0, **changes}))


@pytest.mark.parametrize(
    ("course", "states"),
    [  # verbs and seconds that pass, the state after each pair
        ("start 7.9, - 0.2, - 0.3", "ramp_up full_voltage bypass"),
        ("start 10, stop 3.9, - 1", "bypass ramp_down stopped"),
        ("start 10, cut 0, - 6.1", "bypass coasting stopped"),
        ("start 10, stop 2, start 4.1", "bypass ramp_down full_voltage"),  # it begins from that speed
        ("jog 5, start 0, stop 1", "jog jog stopped"),
        ("start 10, set_mains 10, start 0, jog 0", "bypass stopped stopped stopped"),
    ],
)
def test_a_motor_goes_from_state_to_state(course: str, states: str) -> None:
    motor = standing(ramp_down_s=4.0, coast_s=6.0)
    seen = []
    for verb, seconds in (each.split() for each in course.split(", ")):
        if verb == "set_mains":
            motor.set_mains(is_present=False)
        elif verb != "-":
            getattr(motor, verb)()
        motor.step(float(seconds))
        seen.append(motor.state.name.lower())

    assert seen == states.split()


@pytest.mark.parametrize(
    ("load_pct", "friction_pct", "voltage_pct"),
    [(10.0, 0.0, 100.0), (120.0, 60.0, 100.0), (120.0, 60.0, 85.0)],
)
def test_a_start_lasts_and_draws_what_load_friction_and_supply_make_of_it(
    load_pct: float, friction_pct: float, voltage_pct: float
) -> None:
    motor = standing(rated_current_a=85.0, load_pct=load_pct, friction_pct=friction_pct)
    motor.set_line_voltage(voltage_pct)
    motor.start()
    currents_a = []
    while motor.state is MotorState.RAMP_UP:
        currents_a.append(motor.current_a)
        motor.step(0.01)

    voltage = voltage_pct / 100
    load = load_pct / 100 * (1 + 0.25 * friction_pct / 100) / voltage
    assert 0.01 * len(currents_a) == pytest.approx(8.0 * (1 + friction_pct / 100) / voltage**2, abs=0.02)
    assert currents_a[0] == pytest.approx(1.5 * 85.0)
    assert max(currents_a) == pytest.approx(3.5 * 85.0)
    assert currents_a[-1] == pytest.approx(85.0 * math.hypot(0.3, math.sqrt(1 - 0.3**2) * load), abs=3.0)
