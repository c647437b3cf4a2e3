"""The measurements and counters of a simulated SSW900, by the codes of table A.2."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gateway.sim.core.registers import Measured

if TYPE_CHECKING:
    from gateway.sim.ssw900.unit import Ssw900

_MODEL_CURRENTS_A = (30, 105, 200, 412, 670, 950, 1400)  # upper ends of the values of S3.3.1
_RS485 = 2  # S3.5.1, S3.5.2


def readings(unit: Ssw900) -> Measured:
    """Return everything that can only be read and is not 0."""
    return {**_electric(unit), **_diagnostics(unit), **_device(unit), **_outputs(unit)}


def _electric(unit: Ssw900) -> Measured:
    meter, motor = unit.meter, unit.motor
    volts = meter.line_voltage_v
    line_pct = 100 * volts / motor.data.rated_voltage_v
    phases = zip(("S1.1.1", "S1.1.2", "S1.1.3"), meter.phase_currents_a, strict=True)
    lines = zip(("S1.2.1", "S1.2.2", "S1.2.3"), meter.line_voltages_v, strict=True)
    blocking_v = 0.0 if motor.is_fed else volts / 3**0.5
    return {
        "S1.1.6": meter.current_pct * motor.data.rated_current_a / unit.setup.rated_current_a,
        "S1.1.5": meter.current_pct,
        "S1.1.4": meter.current_a,
        **dict(phases),
        "S1.2.4": volts,
        **dict(lines),
        "S1.2.5": line_pct,
        "S1.2.6": line_pct,
        "S1.3.1": volts * motor.output_pct / 100,
        "S1.3.2": motor.output_pct,
        **dict.fromkeys(("S1.4.1", "S1.4.2", "S1.4.3"), blocking_v),
        "S1.5.1": meter.active_kw,
        "S1.5.2": meter.apparent_kva,
        "S1.5.3": meter.reactive_kvar,
        "S1.5.4": motor.power_factor,
        "S1.6.1": int(motor.is_mains_present),
        "S1.6.2": meter.line_frequency_hz,
        "S1.6.3": int(motor.is_mains_present),
        "S1.7.1": meter.torque_pct,
    }


def _diagnostics(unit: Ssw900) -> Measured:
    motor, counters = unit.motor, unit.motor.counters
    rated_v, frequency_hz = motor.data.rated_voltage_v, motor.data.frequency_hz
    return {
        "D1.1.1": unit.fault,
        **{f"D2.1.{place}": number for place, number in enumerate(unit.alarms[:5], 1)},
        "D4.1.1": counters.start_max_a,
        "D4.1.2": counters.start_max_a * 0.9,
        "D4.2.1": counters.start_s,
        "D4.2.2": counters.start_s,
        "D4.3.1": counters.full_voltage_max_a,
        "D4.4.1": rated_v * 1.01,
        "D4.4.2": rated_v * 0.97,
        "D4.5.1": frequency_hz + 0.1,
        "D4.5.2": frequency_hz - 0.1,
        "D4.6.1": counters.energy_kwh,
        "D4.7.1": counters.starts,
        "D5.1.1": motor.heatsink_c,
        "D6.1": counters.powered_s,
        "D6.2": counters.running_s,
        "D6.3": counters.running_s,
        "S4.1.1": motor.heatsink_c,
        "S4.2.1": min(motor.thermal_pct, 100.0),
        **{f"S4.3.{channel}": 25 + motor.thermal_pct * 0.9 for channel in range(1, 7)},
    }


def _device(unit: Ssw900) -> Measured:
    shown = (0, 0) if unit.quirks.hides_command_bits else unit.command_words.values()
    return {
        "S1.8.1": 230.0,
        "S1.8.2": 5.0,
        "S1.8.3": 12.0,
        "S1.8.4": 3.1,
        "S1.8.5": 48.0,
        "S3.1.1": unit.state_number(),
        "S3.1.2": unit.active_source(),
        "S3.1.3.1": unit.status_word(),
        **dict.fromkeys(("S3.2.1", "S3.2.2.1", "S3.2.2.6"), float(unit.setup.firmware)),
        **dict.fromkeys(("S3.2.2.3", "S3.2.2.8" if unit.slot == 1 else "S3.2.2.10"), 1.0),
        "S3.3.1": sum(unit.setup.rated_current_a > limit_a for limit_a in _MODEL_CURRENTS_A),
        "S3.3.4": unit.setup.serial_number or 1_000_000 + unit.setup.seed,
        "S3.4.1": int(unit.motor.is_fed),
        f"S3.5.{unit.slot}": _RS485,
        **dict(zip(("S5.2.5", "S5.2.6"), shown, strict=True)),
        "S5.4.1": 2 if unit.is_silence_shown else 1,
        "S5.4.2": unit.received & 0xFFFF,
        "S5.4.3": unit.transmitted & 0xFFFF,
        "S5.4.4": unit.crc_errors & 0xFFFF,
        "S5.4.5": unit.byte_errors & 0xFFFF,
    }


def _outputs(unit: Ssw900) -> Measured:
    """The outputs that the family's profile can drive follow their words when set to do so (C4.2, C4.3)."""
    rows, settings = unit.registers.profile.parameters, unit.settings
    digital, tenbit = 0, 0
    for output in unit.registers.profile.outputs.values():
        if settings[rows[output.function].address] != output.option:
            continue
        value = settings[rows[output.word].address]
        digital |= 0 if output.bit is None else value & 1 << output.bit
        tenbit = value if output.bit is None else tenbit
    share = tenbit / 1023
    return {
        "S2.1.1": int(unit.is_enable_input_on),
        "S2.1.2": digital,
        "S2.2.1": share * 100,
        "S2.2.2": share * 20,
        "S2.2.3": share * 10,
        "S2.2.4": tenbit,
    }
