"""The simulated motor: ramps, currents, temperatures, trips, counters."""

from __future__ import annotations

import math

import pytest

from gateway.sim.core.meter import Meter
from gateway.sim.core.motor import AMBIENT_C, Motor
from gateway.sim.core.power import TRANSITIONS, MotorData, MotorEvent, MotorState, MotorTrip

DATA = MotorData(rated_current_a=100.0, load_pct=70.0, ramp_up_s=8.0, ramp_down_s=4.0, coast_s=6.0)


def started(**changes: float) -> Motor:
    motor = Motor(MotorData(**{"rated_current_a": 100.0, **changes}))
    motor.start()
    return motor


def test_a_start_leads_by_ramp_to_full_voltage_and_then_to_the_bypass() -> None:
    motor = Motor(DATA)
    motor.start()

    assert motor.state is MotorState.RAMP_UP
    motor.step(7.9)
    assert motor.state is MotorState.RAMP_UP
    motor.step(0.2)
    assert motor.state is MotorState.FULL_VOLTAGE
    motor.step(0.3)
    assert motor.state is MotorState.BYPASS


def test_a_stop_leads_by_ramp_to_standstill() -> None:
    motor = Motor(DATA)
    motor.start()
    motor.step(10.0)
    motor.stop()
    motor.step(3.9)

    assert motor.state is MotorState.RAMP_DOWN
    motor.step(1.0)
    assert motor.state is MotorState.STOPPED
    assert motor.standstill_s == pytest.approx(0.9, abs=0.01)


def test_a_cut_lets_the_motor_coast_without_current() -> None:
    motor = Motor(DATA)
    motor.start()
    motor.step(10.0)
    motor.cut()

    assert motor.state is MotorState.COASTING
    assert motor.current_a == 0.0
    motor.step(6.1)
    assert motor.state is MotorState.STOPPED


def test_a_start_while_it_still_runs_begins_from_that_speed() -> None:
    motor = Motor(DATA)
    motor.start()
    motor.step(10.0)
    motor.stop()
    motor.step(2.0)
    motor.start()
    motor.step(4.1)

    assert motor.is_at_full_voltage
    assert motor.starts == 2


def test_the_start_draws_several_times_the_rated_current_then_the_load() -> None:
    motor = Motor(DATA)
    motor.start()
    motor.step(4.0)

    assert motor.is_current_limited
    assert motor.current_a == pytest.approx(350.0)
    motor.step(6.0)
    assert 60.0 < motor.current_a < 80.0


def test_the_current_grows_with_the_load() -> None:
    motor = Motor(DATA)
    motor.start()
    motor.step(10.0)
    currents = []
    for load_pct in (0.0, 50.0, 100.0):
        motor.load_pct = load_pct
        currents.append(motor.current_pct)

    assert currents == sorted(currents)
    assert currents[0] == pytest.approx(30.0)
    assert currents[-1] == pytest.approx(100.0)


def test_an_overload_trips_after_minutes() -> None:
    motor = started(load_pct=150.0)
    motor.step(10.0)
    assert motor.trip is None

    motor.step(1200.0)

    assert motor.trip is MotorTrip.OVERLOAD
    assert not motor.is_turned_on


def test_a_blocked_rotor_trips_on_overcurrent_within_seconds() -> None:
    motor = started(load_pct=70.0)
    motor.step(10.0)
    motor.load_pct = 400.0
    motor.step(2.0)

    assert motor.trip is MotorTrip.OVERCURRENT
    assert motor.state is MotorState.COASTING


def test_the_thermal_image_warms_while_starting_and_cools_at_standstill() -> None:
    motor = started()
    motor.step(8.0)
    warm_pct = motor.thermal_pct
    motor.cut()
    motor.step(3600.0)

    assert warm_pct > 5.0
    assert motor.thermal_pct < warm_pct / 5


def test_the_heatsink_warms_by_starts_and_cools_behind_the_bypass() -> None:
    motor = started()
    motor.step(8.0)
    hot_c = motor.heatsink_c
    motor.step(600.0)

    assert hot_c > AMBIENT_C + 5
    assert motor.heatsink_c < hot_c


def test_many_small_steps_end_where_a_big_one_does() -> None:
    big, small = started(), started()
    big.step(60.0)
    for _ in range(600):
        small.step(0.1)

    assert small.state is big.state
    assert small.thermal_pct == pytest.approx(big.thermal_pct, rel=0.02)
    assert small.energy_kwh == pytest.approx(big.energy_kwh, rel=0.05)


def test_counters_count_starts_hours_and_energy() -> None:
    motor = started()
    motor.step(3600.0)

    assert motor.starts == 1
    assert motor.running_s == pytest.approx(3600.0)
    assert motor.powered_s == pytest.approx(3600.0)
    assert 20 < motor.energy_kwh < 60
    assert motor.start_s == pytest.approx(8.0, abs=0.05)
    assert motor.start_max_a == pytest.approx(350.0)


def test_without_mains_nothing_starts_and_what_runs_coasts() -> None:
    motor = started()
    motor.step(10.0)
    motor.set_mains(is_present=False)

    assert motor.state is MotorState.COASTING
    motor.step(10.0)
    motor.start()
    motor.jog()
    assert motor.state is MotorState.STOPPED


def test_a_jog_runs_slowly_until_stopped() -> None:
    motor = Motor(DATA)
    motor.jog()
    motor.step(5.0)

    assert motor.state is MotorState.JOG
    assert motor.current_pct == pytest.approx(200.0)
    motor.start()
    assert motor.starts == 0
    motor.stop()
    motor.step(1.0)
    assert motor.state is MotorState.STOPPED


def test_ramps_of_no_length_are_over_at_once() -> None:
    motor = started(ramp_up_s=0.0, ramp_down_s=0.0)
    motor.step(0.01)
    assert motor.is_at_full_voltage

    motor.stop()
    motor.step(0.01)
    assert motor.state is MotorState.STOPPED


def test_an_event_that_cannot_happen_is_a_bug() -> None:
    motor = Motor(DATA)

    with pytest.raises(KeyError):
        motor._enter(MotorEvent.ELAPSED)


def test_every_state_can_be_cut() -> None:
    assert all((state, MotorEvent.CUT) in TRANSITIONS for state in MotorState)


def test_readings_jitter_alike_for_the_same_seed() -> None:
    def course(seed: int) -> list[float]:
        motor = Motor(DATA)
        meter = Meter(motor, seed=seed)
        motor.start()
        values = []
        for _ in range(20):
            motor.step(1.0)
            values.append(meter.current_a)
        return values

    assert course(1) == course(1)
    assert course(1) != course(2)


def test_readings_at_rest_are_zero_but_for_the_line() -> None:
    motor = Motor(DATA)
    meter = Meter(motor)

    assert (meter.current_a, meter.active_kw, meter.torque_pct) == (0.0, 0.0, 0.0)
    assert meter.line_voltage_v == pytest.approx(400.0, rel=0.01)
    assert meter.line_frequency_hz == pytest.approx(50.0, abs=0.1)


def test_readings_of_a_running_motor_fit_together() -> None:
    motor = Motor(DATA)
    meter = Meter(motor)
    motor.start()
    motor.step(20.0)

    assert sum(meter.phase_currents_a) / 3 == pytest.approx(meter.current_a)
    assert math.hypot(meter.active_kw, meter.reactive_kvar) == pytest.approx(meter.apparent_kva)
    assert meter.torque_pct == 70.0


def test_without_mains_the_line_reads_zero() -> None:
    motor = Motor(DATA)
    motor.set_mains(is_present=False)
    meter = Meter(motor)

    assert (meter.line_voltage_v, meter.line_frequency_hz) == (0.0, 0.0)


@pytest.mark.parametrize("moment_s", [0.1, 4.0, 7.5])
def test_the_voltage_rises_with_the_ramp(moment_s: float) -> None:
    motor = Motor(DATA)
    meter = Meter(motor)
    motor.start()
    motor.step(moment_s)

    assert 30.0 < motor.output_pct < 100.0
    assert meter.torque_pct > 0
    assert motor.power_factor == 0.35
