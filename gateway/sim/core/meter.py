"""The measurements of a starter on its motor: true values with the noise of measuring."""

from __future__ import annotations

import math
import random

from gateway.sim.core.motor import Motor
from gateway.sim.core.power import AT_SPEED

_NOISE_EVERY_S = 0.25


class Meter:
    """The readings of one motor; they jitter a little, alike for the same seed and the same course."""

    def __init__(self, motor: Motor, *, seed: int = 0) -> None:
        self._motor = motor
        self._random = random.Random(seed)
        self._drawn_s = -math.inf
        self._value = 0.0

    @property
    def current_pct(self) -> float:
        """The current in percent of the rated one, with the noise of measuring."""
        return self._motor.current_pct * (1 + 0.004 * self._noise())

    @property
    def current_a(self) -> float:
        """The mean current of the three phases."""
        return self.current_pct / 100 * self._motor.data.rated_current_a

    @property
    def phase_currents_a(self) -> tuple[float, float, float]:
        """The currents of R, S and T: nearly, but never quite, alike; a lost phase carries none."""
        factors = [1.01, 1.0, 0.99]
        if self._motor.lost_phase is not None:
            factors[self._motor.lost_phase] = 0.0
        mean_a = self.current_a * 3 / sum(factors)
        first, second, third = (mean_a * factor for factor in factors)
        return first, second, third

    @property
    def line_voltage_v(self) -> float:
        """The mean line voltage; the start current pulls it down a little."""
        return sum(self.line_voltages_v) / 3

    @property
    def line_voltages_v(self) -> tuple[float, float, float]:
        """The voltages R-S, S-T and T-R; the two of a lost phase are half as high."""
        motor = self._motor
        if not motor.is_mains_present:
            return 0.0, 0.0, 0.0
        sag = 0.00008 * motor.current_pct
        supply_v = motor.data.rated_voltage_v * motor.line_voltage_pct / 100
        volts = supply_v * (1 - sag) * (1 + 0.001 * self._noise())
        lost = motor.lost_phase
        touching = () if lost is None else (lost, (lost + 2) % 3)  # R-S and T-R touch R
        first, second, third = (
            volts * factor * (0.5 if place in touching else 1.0)
            for place, factor in enumerate((1.002, 1.0, 0.998))
        )
        return first, second, third

    @property
    def line_frequency_hz(self) -> float:
        """The line frequency."""
        return self._motor.data.frequency_hz + 0.01 * self._noise() if self._motor.is_mains_present else 0.0

    @property
    def apparent_kva(self) -> float:
        """The apparent power at the output."""
        volts = self.line_voltage_v * self._motor.output_pct / 100
        return math.sqrt(3) * volts * self.current_a / 1000

    @property
    def active_kw(self) -> float:
        """The active power at the output."""
        return self.apparent_kva * self._motor.power_factor

    @property
    def reactive_kvar(self) -> float:
        """The reactive power at the output."""
        return self.apparent_kva * math.sqrt(1 - self._motor.power_factor**2)

    @property
    def torque_pct(self) -> float:
        """The torque in percent of the rated one."""
        if self._motor.state in AT_SPEED:
            return self._motor.load_pct
        return (self._motor.output_pct / 100) ** 2 * 160 if self._motor.is_fed else 0.0

    def _noise(self) -> float:
        """Return the present noise, in standard deviations; drawn again now and then."""
        now_s = self._motor.counters.powered_s
        if now_s - self._drawn_s >= _NOISE_EVERY_S:
            self._drawn_s = now_s
            self._value = max(-2.5, min(2.5, self._random.gauss(0.0, 1.0)))
        return self._value
