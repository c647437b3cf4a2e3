"""What a simulated SSW900 measures and counts, by net id (ssw900 table A.2)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from gateway.sim.core.requests import word

if TYPE_CHECKING:
    from gateway.sim.ssw900.unit import Ssw900

_MODEL_CURRENTS_A = (30, 105, 200, 412, 670, 950, 1400)  # upper ends of the values of S3.3.1
_RS485 = 2  # S3.5.1, S3.5.2
_WITH_COMMUNICATION, _ANALOG_BY_COMMUNICATION = 12, 9  # C4.2.x, C4.3.1


def readings(unit: Ssw900) -> Mapping[int, int]:
    """Return everything that can only be read and is not 0, as whole numbers by net id."""
    return {**_electric(unit), **_diagnostics(unit), **_device(unit), **_outputs(unit)}


def digital_outputs(unit: Ssw900) -> int:
    """Return DO1-DO3; those set to Communication follow S5.3.1 (C4.2)."""
    ours = sum(1 << place for place in range(3) if unit.setting(275 + place) == _WITH_COMMUNICATION)
    return unit.setting(695) & ours


def analog_output(unit: Ssw900) -> int:
    """Return the analog output in ten bits; it follows S5.3.2.1 when set to Value to AO (C4.3)."""
    return unit.setting(696) if unit.setting(251) == _ANALOG_BY_COMMUNICATION else 0


def _electric(unit: Ssw900) -> dict[int, int]:
    meter, motor = unit.meter, unit.motor
    volts = meter.line_voltage_v
    line_pct = 100 * volts / motor.data.rated_voltage_v
    to_rated = motor.data.rated_current_a / unit.rated_current_a
    phases_a = meter.phase_currents_a
    blocking_v = 0.0 if motor.is_fed else volts / 3**0.5
    return {
        1: word(meter.current_pct * to_rated, 1),
        2: word(meter.current_pct, 1),
        3: word(line_pct, 1),
        4: word(volts, 1),
        5: word(line_pct, 1),
        6: word(motor.output_pct, 1),
        7: word(volts * motor.output_pct / 100, 1),
        8: word(motor.power_factor, 2),
        9: word(meter.torque_pct, 1),
        10: round(meter.active_kw * 10),
        12: round(meter.apparent_kva * 10),
        14: round(meter.reactive_kvar * 10),
        16: int(motor.is_mains_present),
        17: word(meter.line_frequency_hz, 1),
        18: 1 if motor.is_mains_present else 0,
        **dict.fromkeys((21, 22, 23), word(blocking_v, 1)),
        24: round(meter.current_a * 10),
        **{26 + 2 * place: round(phase_a * 10) for place, phase_a in enumerate(phases_a)},
        **{33 + place: word(each_v, 1) for place, each_v in enumerate(meter.line_voltages_v)},
    }


def _diagnostics(unit: Ssw900) -> dict[int, int]:
    motor = unit.motor
    heatsink_c = round(motor.heatsink_c)
    rated_v = motor.data.rated_voltage_v
    return {
        36: round(motor.start_max_a * 10),
        38: round(motor.start_max_a * 9),
        40: round(motor.full_voltage_max_a * 10),
        42: round(motor.powered_s),
        44: round(motor.running_s),
        46: round(motor.running_s),
        48: word(motor.start_s),
        49: word(motor.start_s),
        50: word(min(motor.thermal_pct, 100.0), 1),
        52: round(motor.energy_kwh * 10),
        54: word(rated_v * 1.01, 1),
        55: word(rated_v * 0.97, 1),
        56: word(motor.data.frequency_hz + 0.1, 1),
        57: word(motor.data.frequency_hz - 0.1, 1),
        59: motor.starts & 0xFFFF,
        60: heatsink_c,
        **{channel: round(25 + motor.thermal_pct * 0.9) for channel in range(63, 69)},
        77: heatsink_c,
        90: unit.fault,
        **{91 + place: number for place, number in enumerate(unit.alarms[:5])},
    }


def _device(unit: Ssw900) -> dict[int, int]:
    version = int(unit.firmware.replace(".", ""))
    return {
        71: word(230.0, 1),
        72: word(5.0, 2),
        73: word(12.0, 1),
        75: word(3.1, 2),
        76: word(48.0, 1),
        232: unit.active_source(),
        293: int(unit.motor.is_fed),
        294: sum(unit.rated_current_a > limit_a for limit_a in _MODEL_CURRENTS_A),
        298: unit.serial_number,
        **dict.fromkeys((328, 330, 331), version),
        329: 100,
        333 if unit.slot == 1 else 334: 100,
        335: _RS485 if unit.slot == 1 else 0,
        336: _RS485 if unit.slot == 2 else 0,
        679: unit.state_number(),
        680: unit.status_word(),
        735: 2 if unit.is_silence_shown else 1,
        736: unit.received & 0xFFFF,
        737: unit.transmitted & 0xFFFF,
        738: unit.crc_errors & 0xFFFF,
        739: unit.byte_errors & 0xFFFF,
    }


def _outputs(unit: Ssw900) -> dict[int, int]:
    tenbit = analog_output(unit)
    share = tenbit / 1023
    return {
        673: word(share * 100, 2),
        674: word(share * 20, 3),
        675: word(share * 10, 3),
        676: tenbit,
        677: int(unit.is_enable_input_on),
        678: digital_outputs(unit),
    }
