"""A three-phase motor behind a soft starter: speed, current, temperatures, counters; no wire, no clock.

It can age (`friction_pct`), lose a phase and suffer dips of the supply. `start_curve` says how it starts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

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
from gateway.sim.core.start_curve import (
    FALLING,
    RISEN,
    load_current_pct,
    ramp_current_pct,
    ramp_s,
)

AMBIENT_C = 25.0
PHASES = ("r", "s", "t")

_ON_TWO_PHASES = 2 / math.sqrt(3)  # mean of the three currents: the two that are left are 1.73 times as high
_JOG_SPEED = 0.1
_JOG_CURRENT_PCT = 200.0
_BRAKING_CURRENT_PCT = 150.0
_IMAGE_LIMIT = 1.15  # times the rated current that the thermal image bears permanently
_FINE_STEP_S = 0.1  # while the current changes
_COARSE_STEP_S = 1.0  # while the thermal image heads for a trip
_WEARING_STEP_S = 600.0  # while friction grows by the hour


@dataclass(slots=True)
class Counters:
    """The counters and the memory of a starter about its motor."""

    starts: int = 0
    running_s: float = 0.0
    powered_s: float = 0.0
    energy_kwh: float = 0.0
    start_s: float = 0.0  # length of the latest ramp, so far
    start_max_a: float = 0.0
    full_voltage_max_a: float = 0.0


class Motor:
    """One motor; `step` lets time pass, the verbs act at once."""

    def __init__(self, data: MotorData | None = None) -> None:
        self.data = data if data is not None else MotorData()
        self.state = MotorState.STOPPED
        self.speed = 0.0  # 0..1 of the rated speed
        self.friction_pct = self.data.friction_pct  # grows with starts and hours
        self.line_voltage_pct = 100.0
        self.lost_phase: int | None = None  # of `PHASES`, on the side of the supply
        self.is_mains_present = True
        self.trip: MotorTrip | None = None  # set when a protection acts; the starter clears it
        self.standstill_s = math.inf  # since the motor came to rest
        self.thermal_pct = self.data.thermal_pct  # 100 trips
        self.heatsink_c = AMBIENT_C
        self.counters = Counters()
        self._wrong_s = dict.fromkeys(MotorTrip, 0.0)  # for how long a protection has seen its cause
        self._dip_left_s = math.inf  # of the present line voltage
        self._left_s = 0.0  # of full voltage before the bypass, or of braking

    def start(self) -> None:
        """Accelerate by ramp; without mains nothing happens."""
        if not self.is_mains_present or self.state in TURNED_ON or self.state is MotorState.JOG:
            return
        self._enter(MotorEvent.START)
        self.counters.starts += 1
        self.counters.start_s = self.counters.start_max_a = 0.0

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

    def become(self, data: MotorData) -> None:
        """Be another motor from now on: its load, friction and heat are those of the new one."""
        self.data, self.friction_pct, self.thermal_pct = data, data.friction_pct, data.thermal_pct

    def set_line_voltage(self, percent: float, *, for_s: float = math.inf) -> None:
        """Let the supply have another voltage, in percent of the rated one, until it is 100 % again."""
        self.line_voltage_pct, self._dip_left_s = percent, for_s

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
    def load_pct(self) -> float:
        """The load, in percent of the rated one."""
        return self.data.load_pct

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
        return self.state is MotorState.RAMP_UP and RISEN <= self.speed <= FALLING

    @property
    def has_all_phases(self) -> bool:
        """Whether the power section is supplied, on all three phases."""
        return self.is_mains_present and self.lost_phase is None and self.line_voltage_pct > 0

    @property
    def current_pct(self) -> float:
        """The mean current of the three phases, in percent of the rated one."""
        return self._current_pct() * (1.0 if self.lost_phase is None else _ON_TWO_PHASES)

    def _current_pct(self) -> float:
        load_pct = load_current_pct(
            self.load_pct, friction_pct=self.friction_pct, line_voltage_pct=self.line_voltage_pct
        )
        match self.state:
            case MotorState.RAMP_UP:
                peak_pct = max(self.data.start_current_pct, load_pct)
                return ramp_current_pct(self.speed, peak_pct=peak_pct, load_pct=load_pct)
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
        self._wrong_s[MotorTrip.OVERCURRENT] = 0.0
        if following is MotorState.STOPPED:
            self.speed = 0.0
            self.standstill_s = 0.0
        elif following is MotorState.JOG:
            self.speed = _JOG_SPEED
        elif following is MotorState.BRAKING:
            self._left_s = self.data.braking_s
        elif following is MotorState.FULL_VOLTAGE:
            self.speed = 1.0
            self.counters.full_voltage_max_a = 0.0
            self._left_s = self.data.full_voltage_s
            self.friction_pct += self.data.wear_per_start_pct

    def _piece_s(self) -> float:
        """Return how long the present state can be computed in one step."""
        longest_s = max(self._dip_left_s, 1e-9)
        if self.state is MotorState.STOPPED:
            return longest_s
        if self.state is MotorState.BYPASS:
            is_wrong = any(self._sees(trip) for trip in MotorTrip)
            wearing_s = _WEARING_STEP_S if self.data.wear_per_hour_pct else math.inf
            step_s = _FINE_STEP_S if is_wrong else _COARSE_STEP_S if self._is_heating() else wearing_s
            return min(longest_s, step_s)
        return max(min(longest_s, self.ends_in_s, _FINE_STEP_S), 1e-9)

    @property
    def ends_in_s(self) -> float:
        """How long until the present state ends by itself."""
        match self.state:
            case MotorState.RAMP_UP:
                return (1 - self.speed) * self._ramp_s() if self.lost_phase is None else math.inf
            case MotorState.FULL_VOLTAGE | MotorState.BRAKING:
                return self._left_s
            case MotorState.RAMP_DOWN:
                return self.speed * self.data.ramp_down_s
            case MotorState.COASTING:
                return self.speed * self.data.coast_s
            case MotorState.STOPPED | MotorState.BYPASS | MotorState.JOG:
                return math.inf

    def _pass(self, piece_s: float) -> None:
        """Let a piece of time pass in which the state stays as it is, and leave the state at its end."""
        is_over = piece_s >= self.ends_in_s - 1e-9
        self._warm(piece_s)
        self._advance(piece_s)
        self._count(piece_s)
        self._dip_left_s -= piece_s
        if self._dip_left_s <= 1e-9:
            self.set_line_voltage(100.0)
        if is_over:
            self._enter(MotorEvent.ELAPSED)
        self._protect(piece_s)

    def _advance(self, piece_s: float) -> None:
        match self.state:
            case MotorState.RAMP_UP:
                if self.lost_phase is None:  # on two phases there is no torque to accelerate with
                    self.speed = min(1.0, self.speed + piece_s / max(self._ramp_s(), 1e-9))
            case MotorState.RAMP_DOWN:
                self.speed = max(0.0, self.speed - piece_s / max(self.data.ramp_down_s, 1e-9))
            case MotorState.COASTING:
                self.speed = max(0.0, self.speed - piece_s / max(self.data.coast_s, 1e-9))
            case MotorState.BRAKING:
                self.speed *= max(0.0, 1 - piece_s / max(self._left_s, 1e-9))
                self._left_s -= piece_s
            case MotorState.FULL_VOLTAGE:
                self._left_s -= piece_s
            case MotorState.STOPPED:
                self.standstill_s += piece_s
            case MotorState.BYPASS | MotorState.JOG:
                pass

    def _count(self, piece_s: float) -> None:
        counters = self.counters
        if self.is_fed:
            counters.running_s += piece_s
            self.friction_pct += self.data.wear_per_hour_pct * piece_s / 3600
            volts = self.data.rated_voltage_v * self.line_voltage_pct / 100 * self.output_pct / 100
            active_kw = math.sqrt(3) * volts * self.current_a * self.power_factor / 1000
            counters.energy_kwh += active_kw * piece_s / 3600
        if self.state is MotorState.RAMP_UP:
            counters.start_s += piece_s
            counters.start_max_a = max(counters.start_max_a, self.current_a)
        elif self.state in AT_SPEED:
            counters.full_voltage_max_a = max(counters.full_voltage_max_a, self.current_a)
        counters.powered_s += piece_s

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
        """Trip on what a protection has seen for its time."""
        limits_s = {
            MotorTrip.OVERLOAD: 0.0,
            MotorTrip.OVERCURRENT: self.data.overcurrent_s,
            MotorTrip.PHASE_LOSS: self.data.phase_loss_s,
            MotorTrip.UNDERVOLTAGE: self.data.undervoltage_s,
        }
        for trip, limit_s in limits_s.items():
            self._wrong_s[trip] = self._wrong_s[trip] + piece_s if self._sees(trip) else 0.0
            if self._wrong_s[trip] > 0 and self._wrong_s[trip] >= limit_s - 1e-9:
                self.trip = trip
                self.cut()
                return

    def _sees(self, trip: MotorTrip) -> bool:
        """Return whether there is, at this moment, what a protection trips on after its time."""
        if not self.is_fed:
            return False
        match trip:
            case MotorTrip.OVERLOAD:
                return self.thermal_pct >= 100.0
            case MotorTrip.OVERCURRENT:
                return self.state in AT_SPEED and self.current_pct > self.data.overcurrent_pct
            case MotorTrip.PHASE_LOSS:
                return self.lost_phase is not None
            case MotorTrip.UNDERVOLTAGE:
                return self.line_voltage_pct < self.data.undervoltage_pct

    def _ramp_s(self) -> float:
        return ramp_s(self.data, friction_pct=self.friction_pct, line_voltage_pct=self.line_voltage_pct)

    def _is_heating(self) -> bool:
        """Return whether the thermal image heads for a trip."""
        return self._image_target_pct() >= 99.0

    def _image_target_pct(self) -> float:
        return 100 * (self.current_pct / 100 / _IMAGE_LIMIT) ** 2
