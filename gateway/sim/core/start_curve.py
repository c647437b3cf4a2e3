"""How a start goes: how long it takes, and the current at each speed.

The current over the speed is made of three straight lines: it rises until 10 % of the speed, is held at the
start current, and falls to the load's from 85 % on. The speed grows evenly; friction makes that slower, and
so does a low supply voltage, with the square of which the torque falls.
"""

from __future__ import annotations

import math

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
