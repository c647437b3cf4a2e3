"""The start of a simulated motor against its closed form: fresh, worn, loaded, on a low voltage."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field

import pytest

from gateway.sim.core.motor import Motor, StartCurve, start_curve
from gateway.sim.core.power import MotorData, MotorState

STEP_S = 0.01
NEARLY = 0.01  # of the closed form


@dataclass
class Start:
    """What someone who samples the motor every 10 ms sees of a start."""

    currents_a: list[float] = field(default_factory=list)

    @property
    def duration_s(self) -> float:
        return len(self.currents_a) * STEP_S

    @property
    def i2t_a2s(self) -> float:
        return sum(current_a**2 * STEP_S for current_a in self.currents_a)

    @property
    def mean_a(self) -> float:
        return sum(self.currents_a) / len(self.currents_a)


def sampled(motor: Motor) -> Start:
    """Start a motor at rest and sample it until full voltage."""
    start = Start()
    motor.start()
    while motor.state is MotorState.RAMP_UP:
        start.currents_a.append(motor.current_a)
        motor.step(STEP_S)
    return start


def agree(start: Start, curve: StartCurve) -> None:
    assert start.duration_s == pytest.approx(curve.duration_s, abs=2 * STEP_S)
    assert max(start.currents_a) == pytest.approx(curve.peak_a, rel=NEARLY)
    assert start.mean_a == pytest.approx(curve.mean_a, rel=NEARLY)
    assert start.i2t_a2s == pytest.approx(curve.i2t_a2s, rel=NEARLY)
    for place, current_a in enumerate(start.currents_a[::50]):
        assert current_a == pytest.approx(curve.current_a(place * 50 * STEP_S), rel=NEARLY)


@pytest.mark.parametrize("load_pct", [10.0, 70.0, 120.0])
@pytest.mark.parametrize("friction_pct", [0.0, 15.0, 60.0])
@pytest.mark.parametrize("voltage_pct", [100.0, 85.0])
def test_a_start_is_that_of_its_closed_form(load_pct: float, friction_pct: float, voltage_pct: float) -> None:
    data = MotorData(rated_current_a=85.0, load_pct=load_pct, friction_pct=friction_pct)
    motor = Motor(data)
    motor.set_line_voltage(voltage_pct)

    agree(sampled(motor), start_curve(data, line_voltage_pct=voltage_pct))


def test_the_curve_of_a_plain_start_can_be_computed_by_hand() -> None:
    data = MotorData(rated_current_a=100.0, load_pct=0.0, ramp_up_s=10.0, start_current_pct=300.0)

    curve = start_curve(data)

    # 1 s from 150 to 300 A, 7.5 s of 300 A, 1.5 s from 300 to 30 A
    assert curve.duration_s == pytest.approx(10.0)
    assert curve.peak_a == pytest.approx(300.0)
    assert curve.mean_a == pytest.approx((225.0 + 7.5 * 300.0 + 1.5 * 165.0) / 10)
    squares = (150**2 + 150 * 300 + 300**2) / 3 + 7.5 * 300**2 + 1.5 * (300**2 + 300 * 30 + 30**2) / 3
    assert curve.i2t_a2s == pytest.approx(squares)
    moments = (0.0, 0.5, 5.0, 9.25, 11.0)
    assert [curve.current_a(each) for each in moments] == pytest.approx([150.0, 225.0, 300.0, 165.0, 30.0])


def test_every_start_of_a_wearing_motor_is_longer_than_the_one_before_and_as_computed() -> None:
    data = MotorData(wear_per_start_pct=2.0, cooling_s=1.0)
    motor = Motor(data)
    durations_s = []
    for number in range(10):
        start = sampled(motor)
        agree(start, start_curve(data, friction_pct=2.0 * number))
        durations_s.append(start.duration_s)
        motor.cut()
        motor.step(600.0)

    assert all(earlier < later for earlier, later in itertools.pairwise(durations_s))
    assert motor.friction_pct == pytest.approx(20.0)
