"""A three-phase motor behind a soft starter: speed, current, temperatures, counters; no wire, no clock."""

from __future__ import annotations

import math

from gateway.sim.core.power import (
    AT_SPEED,
    FED,
    TRANSITIONS,
    TURNED_ON,
    MotorData,
    MotorEvent,
    MotorState,
    MotorTrip,
)

AMBIENT_C = 25.0

_NO_LOAD = 0.3  # of the rated current, magnetising
_JOG_SPEED = 0.1
_JOG_CURRENT_PCT = 200.0
_BRAKING_CURRENT_PCT = 150.0
_IMAGE_LIMIT = 1.15  # times the rated current that the thermal image bears permanently
_FINE_STEP_S = 0.1  # while the current changes
_COARSE_STEP_S = 1.0  # while the thermal image heads for a trip


class Motor:
    """One motor; `step` lets time pass, the verbs act at once."""

    def __init__(self, data: MotorData | None = None) -> None:
        self.data = data if data is not None else MotorData()
        self.state = MotorState.STOPPED
        self.speed = 0.0  # 0..1 of the rated speed
        self.load_pct = self.data.load_pct
        self.is_mains_present = True
        self.trip: MotorTrip | None = None  # set when a protection acts; the starter clears it
        self.standstill_s = math.inf  # since the motor came to rest
        self.thermal_pct = 0.0  # 100 trips
        self.heatsink_c = AMBIENT_C
        self.starts = 0
        self.running_s = 0.0
        self.powered_s = 0.0
        self.energy_kwh = 0.0
        self.start_s = 0.0  # length of the latest ramp, so far
        self.start_max_a = 0.0
        self.full_voltage_max_a = 0.0
        self._overcurrent_s = 0.0
        self._full_voltage_left_s = 0.0
        self._braking_left_s = 0.0

    def start(self) -> None:
        """Accelerate by ramp; without mains nothing happens."""
        if not self.is_mains_present or self.state in TURNED_ON or self.state is MotorState.JOG:
            return
        self._enter(MotorEvent.START)
        self.starts += 1
        self.start_s = 0.0
        self.start_max_a = 0.0

    def stop(self) -> None:
        """Decelerate by ramp, or by DC braking where that is set."""
        is_braked = self.data.braking_s > 0 and self.state in TURNED_ON
        self._enter(MotorEvent.BRAKE if is_braked else MotorEvent.STOP)

    def cut(self) -> None:
        """Take the voltage away; the motor coasts."""
        self._enter(MotorEvent.CUT)

    def jog(self) -> None:
        """Jog at slow speed, until stopped; only from standstill."""
        if self.is_mains_present and self.state is MotorState.STOPPED:
            self._enter(MotorEvent.JOG)

    def set_mains(self, *, is_present: bool) -> None:
        """Switch the supply of the power section."""
        self.is_mains_present = is_present
        if not is_present:
            self.cut()

    def step(self, step_s: float) -> None:
        """Let `step_s` seconds pass."""
        left_s = step_s
        while left_s > 0:
            piece_s = min(left_s, self._piece_s())
            self._pass(piece_s)
            left_s -= piece_s

    @property
    def is_turned_on(self) -> bool:
        """Whether it accelerates or runs: between a start and a stop."""
        return self.state in TURNED_ON

    @property
    def is_turning(self) -> bool:
        """Whether the shaft is in motion, driven or not."""
        return self.state is not MotorState.STOPPED

    @property
    def is_fed(self) -> bool:
        """Whether current flows."""
        return self.state in FED

    @property
    def is_at_full_voltage(self) -> bool:
        """Whether the ramp is over and the whole voltage lies on the motor."""
        return self.state in AT_SPEED

    @property
    def is_current_limited(self) -> bool:
        """Whether the ramp is held back to keep the start current."""
        return self.state is MotorState.RAMP_UP and 0.1 <= self.speed <= 0.85

    @property
    def current_pct(self) -> float:
        """The current in percent of the rated one."""
        load_pct = 100 * math.hypot(_NO_LOAD, math.sqrt(1 - _NO_LOAD**2) * self.load_pct / 100)
        peak_pct = max(self.data.start_current_pct, load_pct)
        match self.state:
            case MotorState.RAMP_UP if self.speed < 0.1:
                return 150 + (peak_pct - 150) * self.speed / 0.1
            case MotorState.RAMP_UP if self.speed > 0.85:
                return load_pct + (peak_pct - load_pct) * (1 - self.speed) / 0.15
            case MotorState.RAMP_UP:
                return peak_pct
            case MotorState.FULL_VOLTAGE | MotorState.BYPASS:
                return load_pct
            case MotorState.RAMP_DOWN:
                return 1.3 * load_pct * (0.4 + 0.6 * self.speed)
            case MotorState.JOG:
                return _JOG_CURRENT_PCT
            case MotorState.BRAKING:
                return _BRAKING_CURRENT_PCT
            case MotorState.STOPPED | MotorState.COASTING:
                return 0.0

    @property
    def power_factor(self) -> float:
        """The power factor; 0 without current."""
        if not self.is_fed:
            return 0.0
        if self.state in AT_SPEED:
            return min(0.9, 0.2 + 0.7 * math.sqrt(self.load_pct / 100))
        return 0.35

    @property
    def output_pct(self) -> float:
        """The voltage on the motor in percent of the line's."""
        if not self.is_fed:
            return 0.0
        if self.state in AT_SPEED:
            return 100.0
        is_low = self.state in (MotorState.JOG, MotorState.BRAKING)
        return 30.0 if is_low else 30.0 + 70.0 * self.speed

    @property
    def current_a(self) -> float:
        """The mean current of the three phases."""
        return self.current_pct / 100 * self.data.rated_current_a

    def _enter(self, event: MotorEvent) -> None:
        """Follow the table of transitions; a pair it does not list is a bug."""
        following = TRANSITIONS[self.state, event]
        if following is self.state:
            return
        self.state = following
        self._overcurrent_s = 0.0
        if following is MotorState.STOPPED:
            self.speed = 0.0
            self.standstill_s = 0.0
        elif following is MotorState.JOG:
            self.speed = _JOG_SPEED
        elif following is MotorState.BRAKING:
            self._braking_left_s = self.data.braking_s
        elif following is MotorState.FULL_VOLTAGE:
            self.speed = 1.0
            self.full_voltage_max_a = 0.0
            self._full_voltage_left_s = self.data.full_voltage_s

    def _piece_s(self) -> float:
        """Return how long the present state can be computed in one step."""
        ends_s = self.ends_in_s
        if self.state is MotorState.STOPPED:
            return math.inf
        if self.state is MotorState.BYPASS:
            is_safe = self._image_target_pct() < 99.0 and not self._is_overcurrent()
            return math.inf if is_safe else _COARSE_STEP_S
        return max(min(ends_s, _FINE_STEP_S), 1e-9)

    @property
    def ends_in_s(self) -> float:
        """How long until the present state ends by itself."""
        match self.state:
            case MotorState.RAMP_UP:
                return (1 - self.speed) * self.data.ramp_up_s
            case MotorState.FULL_VOLTAGE:
                return self._full_voltage_left_s
            case MotorState.RAMP_DOWN:
                return self.speed * self.data.ramp_down_s
            case MotorState.COASTING:
                return self.speed * self.data.coast_s
            case MotorState.BRAKING:
                return self._braking_left_s
            case MotorState.STOPPED | MotorState.BYPASS | MotorState.JOG:
                return math.inf

    def _pass(self, piece_s: float) -> None:
        """Let a piece of time pass in which the state stays as it is, and leave the state at its end."""
        is_over = piece_s >= self.ends_in_s - 1e-9
        self._warm(piece_s)
        self._advance(piece_s)
        self._count(piece_s)
        if is_over:
            self._enter(MotorEvent.ELAPSED)
        self._protect(piece_s)

    def _advance(self, piece_s: float) -> None:
        match self.state:
            case MotorState.RAMP_UP:
                self.speed = min(1.0, self.speed + piece_s / max(self.data.ramp_up_s, 1e-9))
            case MotorState.RAMP_DOWN:
                self.speed = max(0.0, self.speed - piece_s / max(self.data.ramp_down_s, 1e-9))
            case MotorState.COASTING:
                self.speed = max(0.0, self.speed - piece_s / max(self.data.coast_s, 1e-9))
            case MotorState.BRAKING:
                self.speed *= max(0.0, 1 - piece_s / max(self._braking_left_s, 1e-9))
                self._braking_left_s -= piece_s
            case MotorState.FULL_VOLTAGE:
                self._full_voltage_left_s -= piece_s
            case MotorState.STOPPED:
                self.standstill_s += piece_s
            case MotorState.BYPASS | MotorState.JOG:
                pass

    def _count(self, piece_s: float) -> None:
        if self.is_fed:
            self.running_s += piece_s
            volts = self.data.rated_voltage_v * self.output_pct / 100
            active_kw = math.sqrt(3) * volts * self.current_a * self.power_factor / 1000
            self.energy_kwh += active_kw * piece_s / 3600
        if self.state is MotorState.RAMP_UP:
            self.start_s += piece_s
            self.start_max_a = max(self.start_max_a, self.current_a)
        elif self.state in AT_SPEED:
            self.full_voltage_max_a = max(self.full_voltage_max_a, self.current_a)
        self.powered_s += piece_s

    def _warm(self, piece_s: float) -> None:
        """Let the thermal image and the heatsink follow the current."""
        constant_s = self.data.heating_s if self.is_fed else self.data.cooling_s
        target_pct = self._image_target_pct()
        self.thermal_pct += (target_pct - self.thermal_pct) * -math.expm1(-piece_s / constant_s)
        # Only the thyristors heat the heatsink: hardly anything once the bypass is closed.
        is_conducting = self.is_fed and self.state is not MotorState.BYPASS
        square = (self.current_pct / 100) ** 2
        hot_c = AMBIENT_C + (25.0 if is_conducting else 4.0) * square
        self.heatsink_c += (hot_c - self.heatsink_c) * -math.expm1(-piece_s / self.data.heatsink_s)

    def _protect(self, piece_s: float) -> None:
        if not self.is_fed:
            return
        self._overcurrent_s = self._overcurrent_s + piece_s if self._is_overcurrent() else 0.0
        if self._overcurrent_s >= self.data.overcurrent_s:
            self.trip = MotorTrip.OVERCURRENT
            self.cut()
        elif self.thermal_pct >= 100.0:
            self.trip = MotorTrip.OVERLOAD
            self.cut()

    def _is_overcurrent(self) -> bool:
        return self.state in AT_SPEED and self.current_pct > self.data.overcurrent_pct

    def _image_target_pct(self) -> float:
        return 100 * (self.current_pct / 100 / _IMAGE_LIMIT) ** 2
