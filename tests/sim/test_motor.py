"""The simulated motor: ramps, currents, temperatures, trips, counters."""

from __future__ import annotations

import math

import pytest

from gateway.sim.core.meter import Meter
from gateway.sim.core.motor import AMBIENT_C, PHASES, Motor, start_curve
from gateway.sim.core.power import TRANSITIONS, MotorData, MotorEvent, MotorState, MotorTrip


def standing(**changes: float) -> Motor:
    return Motor(MotorData(**{"rated_current_a": 100.0, "load_pct": 70.0, "ramp_up_s": 8.0, **changes}))


def started(after_s: float = 0.0, **changes: float) -> Motor:
    motor = standing(**changes)
    motor.start()
    motor.step(after_s)
    return motor


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


def test_currents_of_start_load_jog_and_coasting() -> None:
    motor = started(4.0)
    assert motor.is_current_limited
    assert motor.current_a == pytest.approx(350.0)
    motor.step(6.0)
    assert 60.0 < motor.current_a < 80.0
    currents = []
    for motor.load_pct in (0.0, 50.0, 100.0):
        currents.append(motor.current_pct)
    assert (currents[0], currents[-1]) == (pytest.approx(30.0), pytest.approx(100.0))
    assert currents == sorted(currents)
    motor.cut()
    assert motor.current_a == 0.0
    motor.step(100.0)
    motor.jog()
    assert motor.current_pct == pytest.approx(200.0)


@pytest.mark.parametrize(
    ("load_pct", "before_s", "after_s", "trip"),
    [(150.0, 10.0, 1200.0, MotorTrip.OVERLOAD), (400.0, 0.5, 2.0, MotorTrip.OVERCURRENT)],
)
def test_an_overload_trips_after_minutes_and_a_blocked_rotor_within_seconds(
    load_pct: float, before_s: float, after_s: float, trip: MotorTrip
) -> None:
    motor = started(10.0)
    motor.load_pct = load_pct
    motor.step(before_s)
    assert motor.trip is None
    motor.step(after_s)

    assert motor.trip is trip
    assert not motor.is_turned_on


def test_heat_comes_with_a_start_and_goes_at_rest_and_behind_the_bypass() -> None:
    motor = started(8.0)
    warm_pct, hot_c = motor.thermal_pct, motor.heatsink_c
    motor.step(600.0)
    assert warm_pct > 5.0
    assert hot_c > AMBIENT_C + 5
    assert motor.heatsink_c < hot_c
    motor.cut()
    motor.step(7200.0)

    assert motor.thermal_pct < warm_pct / 5


def test_many_small_steps_end_where_a_big_one_does() -> None:
    big, small = started(60.0), started()
    for _ in range(600):
        small.step(0.1)

    assert small.state is big.state
    assert small.thermal_pct == pytest.approx(big.thermal_pct, rel=0.02)
    assert small.energy_kwh == pytest.approx(big.energy_kwh, rel=0.05)


def test_counters_count_starts_hours_and_energy() -> None:
    motor = started(3600.0)

    assert (motor.starts, motor.running_s, motor.powered_s) == (
        1,
        pytest.approx(3600.0),
        pytest.approx(3600.0),
    )
    assert 20 < motor.energy_kwh < 60
    assert motor.start_s == pytest.approx(8.0, abs=0.05)
    assert motor.start_max_a == pytest.approx(350.0)
    motor.cut()
    motor.step(1000.0)
    assert motor.running_s == pytest.approx(3600.0)


def test_ramps_of_no_length_are_over_at_once() -> None:
    motor = started(0.01, ramp_up_s=0.0, ramp_down_s=0.0)
    assert motor.is_at_full_voltage
    motor.stop()
    motor.step(0.01)

    assert motor.state is MotorState.STOPPED


def test_every_state_can_be_cut_and_an_event_that_cannot_happen_is_a_bug() -> None:
    assert all((state, MotorEvent.CUT) in TRANSITIONS for state in MotorState)
    with pytest.raises(KeyError):
        standing()._enter(MotorEvent.ELAPSED)


def test_readings_jitter_alike_for_the_same_seed() -> None:
    def course(seed: int) -> list[float]:
        motor = started()
        meter = Meter(motor, seed=seed)
        values = []
        for _ in range(20):
            motor.step(1.0)
            values.append(meter.current_a)
        return values

    assert course(1) == course(1)
    assert course(1) != course(2)


def test_readings_fit_together_at_rest_on_the_ramp_at_speed_and_without_mains() -> None:
    motor = standing()
    meter = Meter(motor)
    assert (meter.current_a, meter.active_kw, meter.torque_pct) == (0.0, 0.0, 0.0)
    assert meter.line_voltage_v == pytest.approx(400.0, rel=0.01)
    assert meter.line_frequency_hz == pytest.approx(50.0, abs=0.1)
    motor.start()
    for moment_s in (0.1, 3.9, 3.5):
        motor.step(moment_s)
        assert 30.0 < motor.output_pct < 100.0
        assert meter.torque_pct > 0
        assert motor.power_factor == 0.35
    motor.step(12.5)
    assert sum(meter.phase_currents_a) / 3 == pytest.approx(meter.current_a)
    assert math.hypot(meter.active_kw, meter.reactive_kvar) == pytest.approx(meter.apparent_kva)
    assert meter.torque_pct == 70.0
    motor.set_mains(is_present=False)
    assert (meter.line_voltage_v, meter.line_frequency_hz) == (0.0, 0.0)


@pytest.mark.parametrize("phase", range(len(PHASES)))
def test_a_lost_phase_carries_nothing_and_the_others_more_until_it_trips(phase: int) -> None:
    motor = started(20.0)
    meter = Meter(motor)
    before_a, motor.lost_phase = motor.current_a, phase
    motor.step(1.0)

    currents_a = list(meter.phase_currents_a)
    assert currents_a.pop(phase) == pytest.approx(0.0)
    assert currents_a == pytest.approx([math.sqrt(3) * before_a] * 2, rel=0.02)
    assert sum(currents_a) / 3 == pytest.approx(meter.current_a)
    assert sorted(meter.line_voltages_v) == pytest.approx([200.0, 200.0, 400.0], rel=0.02)
    assert meter.line_voltage_v == pytest.approx(sum(meter.line_voltages_v) / 3)
    motor.step(1.9)
    assert motor.trip is None
    motor.step(0.2)
    assert motor.trip is MotorTrip.PHASE_LOSS
    assert motor.state is MotorState.COASTING


def test_a_phase_that_comes_back_in_time_trips_nothing() -> None:
    motor = started(20.0)
    for _ in range(10):
        motor.lost_phase = 1
        motor.step(2.0)
        motor.lost_phase = None
        motor.step(1.0)

    assert motor.trip is None


def test_a_motor_does_not_accelerate_on_two_phases() -> None:
    motor = standing()
    motor.lost_phase = 0
    motor.start()
    motor.step(2.9)
    assert (motor.state, motor.trip, motor.speed) == (MotorState.RAMP_UP, None, pytest.approx(0.0))
    motor.step(0.2)

    assert motor.trip is MotorTrip.PHASE_LOSS


def test_a_dip_during_a_start_makes_it_longer_by_what_it_takes_from_the_torque() -> None:
    motor = started(2.0)
    motor.set_line_voltage(90.0, for_s=3.0)
    motor.step(20.0)

    assert motor.line_voltage_pct == pytest.approx(100.0)
    assert motor.start_s == pytest.approx(8.0 + 3.0 * (1 - 0.81), abs=0.02)
    assert motor.start_s > start_curve(motor.data).duration_s


def test_a_low_voltage_shows_in_the_voltage_and_takes_more_current_for_the_load() -> None:
    motor = started(20.0, load_pct=80.0)
    before_a = motor.current_a
    motor.set_line_voltage(90.0)

    assert Meter(motor).line_voltage_v == pytest.approx(360.0, rel=0.02)
    assert before_a * 1.05 < motor.current_a < before_a / 0.9


@pytest.mark.parametrize(
    ("running_s", "percent", "for_s", "trip"),
    [
        (20.0, 79.0, 1.5, MotorTrip.UNDERVOLTAGE),
        (20.0, 79.0, 0.8, None),
        (20.0, 85.0, 60.0, None),
        (0.0, 50.0, 5.0, None),
    ],
)
def test_only_a_deep_and_long_dip_of_a_running_motor_trips(
    running_s: float, percent: float, for_s: float, trip: MotorTrip | None
) -> None:
    motor = started(running_s) if running_s else standing()
    motor.set_line_voltage(percent, for_s=for_s)
    motor.step(for_s - 0.1)
    assert motor.line_voltage_pct == pytest.approx(percent)
    motor.step(100.0)

    assert motor.trip is trip
    assert motor.line_voltage_pct == pytest.approx(100.0)


def test_the_thermal_level_rises_and_cools_with_its_time_constants() -> None:
    motor = started(1.0, load_pct=100.0, heating_s=600.0, cooling_s=1800.0, ramp_up_s=0.1)
    motor.thermal_pct = 0.0
    motor.step(600.0)
    risen_pct = 100 / 1.15**2 * (1 - math.exp(-1))
    assert motor.thermal_pct == pytest.approx(risen_pct, rel=0.01)
    motor.cut()
    motor.step(1800.0)

    assert motor.thermal_pct == pytest.approx(risen_pct * math.exp(-1), rel=0.01)
