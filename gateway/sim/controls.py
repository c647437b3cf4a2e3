"""The knobs of a simulated starter: what a person beside it, its motor and its supply can do to it.

Pure: takes and returns texts.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from typing import TypeVar

from gateway.errors import UsageError
from gateway.sim.core.motor import PHASES
from gateway.sim.core.unit import SimulatedUnit
from gateway.sim.sst.motion import COIL_OVERCURRENT, ERROR_COILS
from gateway.sim.sst.unit import Sst
from gateway.sim.ssw900.unit import Ssw900
from gateway.sim.weg.command_sources import FAULT_OVERLOAD, Supervised
from gateway.sim.weg.ssw06 import Ssw06

_Chosen = TypeVar("_Chosen")

_NUMBER = re.compile(r"(?:[aef]|coil)?0*([1-9][0-9]{0,2})", re.IGNORECASE)  # E05, F128, COIL12, 5
_AMOUNT = re.compile(r"([0-9]{1,6}(?:\.[0-9]{1,6})?)\s*%?")
_ON_OFF = {"on": True, "off": False}


def set_knob(unit: SimulatedUnit, knob: str, setting: str) -> str:
    """Apply one of `KNOBS` to a starter and return what was done; UsageError when it has no such knob."""
    action = _ACTIONS.get(knob)
    if action is None:
        raise UsageError(f"no knob {knob[:20]!r} (one of {', '.join(_ACTIONS)})")
    return action(unit, setting.strip())


def _trip(unit: SimulatedUnit, setting: str) -> str:
    default = COIL_OVERCURRENT if isinstance(unit, Sst) else FAULT_OVERLOAD
    number = _number(setting, default)
    if isinstance(unit, Sst) and number not in ERROR_COILS:
        raise UsageError(f"no error {setting!r} (COIL{ERROR_COILS.start} to COIL{ERROR_COILS.stop - 1})")
    if isinstance(unit, Supervised) and number > 99:
        raise UsageError(f"no fault {setting!r} (E01 to E99)")
    unit.trip(number)
    return f"tripped: {unit.trips[-1].code}"


def _alarm(unit: SimulatedUnit, setting: str) -> str:
    if isinstance(unit, Ssw900):
        number = _number(setting, FAULT_OVERLOAD)
        unit.set_alarm(number, is_on=True)
        return f"alarm A{number:03d}"
    if isinstance(unit, Ssw06):
        unit.is_alarm = True
        return "alarm"
    raise UsageError(f"family {unit.family} has no alarms")


def _clear(unit: SimulatedUnit, _setting: str) -> str:
    unit.reset_at_keypad()
    if isinstance(unit, Ssw900):
        unit.alarms.clear()
    elif isinstance(unit, Ssw06):
        unit.is_alarm = False
    return "faults and alarms cleared"


def _control(unit: SimulatedUnit, setting: str) -> str:
    is_remote = _choice(setting, {"remote": True, "local": False})
    unit.set_remote(is_remote=is_remote)
    return f"{setting.lower()} control"


def _power(unit: SimulatedUnit, setting: str) -> str:
    if _choice(setting, _ON_OFF):
        unit.power_on()
    else:
        unit.power_off()
    return f"control supply {setting.lower()}"


def _mains(unit: SimulatedUnit, setting: str) -> str:
    unit.set_mains(is_present=_choice(setting, _ON_OFF))
    return f"mains {setting.lower()}"


def _keypad(unit: SimulatedUnit, setting: str) -> str:
    is_start = _choice(setting, {"start": True, "stop": False})
    (unit.keypad_start if is_start else unit.keypad_stop)()
    return f"{setting.lower()} pressed (it counts in local control only)"


_OF_THE_MOTOR = {  # the knob's field of `MotorData`, its largest value and what it does
    "load": ("load_pct", 1000, "load {:g} %"),
    "friction": ("friction_pct", 1000, "friction {:g} %: so much longer starts"),
    "wear": ("wear_per_start_pct", 100, "friction grows by {:g} % with each start"),
    "thermal": ("thermal_pct", 100, "thermal level {:g} %"),
}


def _motor(knob: str) -> Callable[[SimulatedUnit, str], str]:
    field, most, said = _OF_THE_MOTOR[knob]

    def act(unit: SimulatedUnit, setting: str) -> str:
        percent = _amount(setting, "%", most=most)
        unit.change_motor(**{field: percent})
        return said.format(percent)

    return act


def _voltage(unit: SimulatedUnit, setting: str) -> str:
    """Take `85` (from now on) or `85 2.5` (for 2.5 s)."""
    percent_text, _, seconds_text = setting.partition(" ")
    percent = _amount(percent_text, "%", most=120)
    seconds = _amount(seconds_text, "s", most=3600) if seconds_text.strip() else math.inf
    unit.set_line_voltage(percent, for_s=seconds)
    return f"line voltage {percent:g} %" + (f" for {seconds:g} s" if math.isfinite(seconds) else "")


def _phase(unit: SimulatedUnit, setting: str) -> str:
    lost = _choice(setting, {**{name: number for number, name in enumerate(PHASES)}, "on": None})
    unit.lose_phase(lost)
    return "all phases are there" if lost is None else f"phase {PHASES[lost].upper()} is lost"


def _amount(setting: str, unit_name: str, *, most: float) -> float:
    found = _AMOUNT.fullmatch(setting.strip())
    if found is None or float(found[1]) > most:
        raise UsageError(f"not {setting[:20]!r} (a number from 0 to {most:g}, in {unit_name})")
    return float(found[1])


def _number(setting: str, default: int) -> int:
    if not setting:
        return default
    found = _NUMBER.fullmatch(setting)
    if found is None:
        raise UsageError(f"no number {setting[:20]!r} (such as E05, F005, A128, COIL12 or 5)")
    return int(found[1])


def _choice(setting: str, choices: Mapping[str, _Chosen]) -> _Chosen:
    if setting.lower() not in choices:
        raise UsageError(f"not {setting[:20]!r} ({' or '.join(choices)})")
    return choices[setting.lower()]


_ACTIONS: dict[str, Callable[[SimulatedUnit, str], str]] = {
    "trip": _trip,
    "alarm": _alarm,
    "clear": _clear,
    "control": _control,
    "power": _power,
    "mains": _mains,
    "keypad": _keypad,
    **{knob: _motor(knob) for knob in _OF_THE_MOTOR},
    "voltage": _voltage,
    "phase": _phase,
}
KNOBS = tuple(_ACTIONS)
