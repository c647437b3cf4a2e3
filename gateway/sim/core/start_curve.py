"""How a start goes, in closed form: the current at each moment, its peak, mean and square over time.

The current over the speed is made of three straight lines: it rises until 10 % of the speed, is held at the
start current, and falls to the load's from 85 % on. The speed grows evenly; friction makes that slower, and
so does a low supply voltage, with the square of which the torque falls.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from gateway.sim.core.power import MotorData

RISEN, FALLING = 0.1, 0.85  # of the rated speed: between them the start current is held
FIRST_PCT = 150.0  # of the rated current, with which a start begins

_NO_LOAD = 0.3  # of the rated current, magnetising
_FRICTION_AS_LOAD = 0.25  # of a motor that needs 100 % longer to accelerate, as more load at speed
_LOWEST_PCT = 1.0  # of the rated voltage; below it nothing moves any more, and nothing is divided by 0


def ramp_s(data: MotorData, *, friction_pct: float, line_voltage_pct: float = 100.0) -> float:
    """Return how long the motor takes from standstill to the rated speed."""
    voltage = max(line_voltage_pct, _LOWEST_PCT) / 100
    return data.ramp_up_s * (1 + friction_pct / 100) / voltage**2


def load_current_pct(load_pct: float, *, friction_pct: float, line_voltage_pct: float = 100.0) -> float:
    """Return the current at speed, in percent of the rated one; a low voltage takes more for a power."""
    load = load_pct / 100 * (1 + _FRICTION_AS_LOAD * friction_pct / 100)
    voltage = max(line_voltage_pct, _LOWEST_PCT) / 100
    return 100 * math.hypot(_NO_LOAD, math.sqrt(1 - _NO_LOAD**2) * load / voltage)


def ramp_current_pct(speed: float, *, peak_pct: float, load_pct: float) -> float:
    """Return the current of a ramp at a speed (0..1), in percent; `load_pct` is the one at its end."""
    if speed < RISEN:
        return FIRST_PCT + (peak_pct - FIRST_PCT) * speed / RISEN
    if speed > FALLING:
        return load_pct + (peak_pct - load_pct) * (1 - speed) / (1 - FALLING)
    return peak_pct


@dataclass(frozen=True, slots=True)
class StartCurve:
    """A start from standstill to the end of its ramp; currents are the mean of the three phases."""

    duration_s: float  # until full voltage
    peak_a: float
    first_a: float
    load_a: float  # at the end

    def current_a(self, at_s: float) -> float:
        """Return the current so long after the start; that of the load once the ramp is over."""
        if at_s >= self.duration_s:
            return self.load_a
        rated_a = self.first_a / FIRST_PCT * 100
        peak_pct, load_pct = (100 * each_a / rated_a for each_a in (self.peak_a, self.load_a))
        percent = ramp_current_pct(at_s / self.duration_s, peak_pct=peak_pct, load_pct=load_pct)
        return percent / 100 * rated_a

    @property
    def mean_a(self) -> float:
        """The mean current until full voltage."""
        return sum(share * (one + other) / 2 for share, one, other in self._lines())

    @property
    def i2t_a2s(self) -> float:
        """The integral of the squared current until full voltage, in A²s."""
        squares = ((share, one**2 + one * other + other**2) for share, one, other in self._lines())
        return self.duration_s * sum(share * square / 3 for share, square in squares)

    def _lines(self) -> tuple[tuple[float, float, float], ...]:
        """Return the share of the time and the current at both ends of each straight line."""
        return (
            (RISEN, self.first_a, self.peak_a),
            (FALLING - RISEN, self.peak_a, self.peak_a),
            (1 - FALLING, self.peak_a, self.load_a),
        )


def start_curve(
    data: MotorData,
    *,
    friction_pct: float | None = None,
    line_voltage_pct: float = 100.0,
    load_pct: float | None = None,
) -> StartCurve:
    """Return how a motor starts from standstill under a steady supply.

    Friction and load are those of its data unless they are given.
    """
    friction_pct = data.friction_pct if friction_pct is None else friction_pct
    load_pct = data.load_pct if load_pct is None else load_pct
    at_speed_pct = load_current_pct(load_pct, friction_pct=friction_pct, line_voltage_pct=line_voltage_pct)
    rated_a = data.rated_current_a
    return StartCurve(
        duration_s=ramp_s(data, friction_pct=friction_pct, line_voltage_pct=line_voltage_pct),
        peak_a=max(data.start_current_pct, at_speed_pct) / 100 * rated_a,
        first_a=FIRST_PCT / 100 * rated_a,
        load_a=at_speed_pct / 100 * rated_a,
    )
