"""The power section of a soft starter as a table of states and events, and a motor's data."""

from __future__ import annotations

import enum
from dataclasses import dataclass


class MotorState(enum.Enum):
    """The states of the power section."""

    STOPPED = "stopped"
    RAMP_UP = "ramp_up"
    FULL_VOLTAGE = "full_voltage"  # the ramp is over, the bypass not yet closed
    BYPASS = "bypass"
    RAMP_DOWN = "ramp_down"
    COASTING = "coasting"  # no voltage, still turning
    JOG = "jog"
    BRAKING = "braking"  # direct current, from a stop until standstill


class MotorEvent(enum.Enum):
    """The faults of the power section."""

    START = "start"
    STOP = "stop"  # by ramp
    BRAKE = "brake"  # by direct current
    CUT = "cut"  # general disable, trip, mains lost: the motor coasts
    JOG = "jog"
    ELAPSED = "elapsed"  # the time of the present state is over


class MotorTrip(enum.Enum):
    """Why the motor's own protections switched it off."""

    OVERLOAD = "overload"  # the thermal image is full
    OVERCURRENT = "overcurrent"
    PHASE_LOSS = "phase_loss"  # one phase of the supply is missing
    UNDERVOLTAGE = "undervoltage"


_S, _E = MotorState, MotorEvent
_DRIVEN = (_S.RAMP_UP, _S.FULL_VOLTAGE, _S.BYPASS)
TRANSITIONS: dict[tuple[MotorState, MotorEvent], MotorState] = {
    (state, event): following
    for event, states, following in (
        (_E.START, (_S.STOPPED, _S.RAMP_UP, _S.RAMP_DOWN, _S.COASTING, _S.BRAKING), _S.RAMP_UP),
        (_E.STOP, (*_DRIVEN, _S.RAMP_DOWN), _S.RAMP_DOWN),
        (_E.STOP, (_S.JOG, _S.COASTING), _S.COASTING),
        (_E.BRAKE, _DRIVEN, _S.BRAKING),
        (_E.CUT, (*_DRIVEN, _S.RAMP_DOWN, _S.JOG, _S.BRAKING, _S.COASTING), _S.COASTING),
        (_E.JOG, (_S.STOPPED,), _S.JOG),
        (_E.ELAPSED, (_S.RAMP_UP,), _S.FULL_VOLTAGE),
        (_E.ELAPSED, (_S.FULL_VOLTAGE,), _S.BYPASS),
        (_E.ELAPSED, (_S.RAMP_DOWN, _S.COASTING, _S.BRAKING), _S.STOPPED),
    )
    for state in states
} | {  # they change nothing
    (_S.STOPPED, _E.STOP): _S.STOPPED,
    (_S.STOPPED, _E.CUT): _S.STOPPED,
    (_S.BRAKING, _E.STOP): _S.BRAKING,
    (_S.FULL_VOLTAGE, _E.START): _S.FULL_VOLTAGE,
    (_S.BYPASS, _E.START): _S.BYPASS,
}

TURNED_ON = frozenset(_DRIVEN)
AT_SPEED = frozenset({_S.FULL_VOLTAGE, _S.BYPASS})
FED = frozenset({_S.RAMP_UP, _S.FULL_VOLTAGE, _S.BYPASS, _S.RAMP_DOWN, _S.JOG, _S.BRAKING})


@dataclass(frozen=True, slots=True)
class MotorData:
    """The name plate, and how this motor and its load behave."""

    rated_current_a: float = 85.0
    rated_voltage_v: float = 400.0
    frequency_hz: float = 50.0
    load_pct: float = 70.0
    start_current_pct: float = 350.0  # of the rated current, held during most of the ramp
    ramp_up_s: float = 8.0
    full_voltage_s: float = 0.3  # from the end of the ramp until the bypass closes
    ramp_down_s: float = 4.0
    braking_s: float = 0.0  # above 0 a stop brakes for so long instead of following the ramp
    coast_s: float = 6.0
    heating_s: float = 600.0  # time constant of the thermal image
    cooling_s: float = 1800.0  # the same at standstill
    heatsink_s: float = 120.0
    overcurrent_pct: float = 250.0  # trips at full voltage
    overcurrent_s: float = 1.0
    undervoltage_pct: float = 80.0  # of the rated voltage; trips while current flows
    undervoltage_s: float = 1.0
    phase_loss_s: float = 3.0  # the same for a missing phase
    friction_pct: float = 0.0  # how much longer than `ramp_up_s` the motor accelerates, as it is delivered
    wear_per_start_pct: float = 0.0  # by so much the friction grows with each start that reaches full voltage
    wear_per_hour_pct: float = 0.0  # the same for each hour of running
    thermal_pct: float = 0.0  # of the thermal image, as it is delivered
