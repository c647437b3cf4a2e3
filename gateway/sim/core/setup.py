"""The parts of a simulated starter: name plate, settings, and its behaviour where no manual decides."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from gateway.sim.core.power import MotorData


@dataclass(frozen=True, slots=True)
class Setup:
    """One starter as it is delivered and set up; a family has its own defaults."""

    seed: int = 0  # of all chance
    model: str = ""  # SST: its whole name
    product: str = ""  # what FC43 calls it before the current
    firmware: str = ""
    serial_number: int = 0  # 0: one by the seed
    rated_current_a: float = 85.0  # of the starter; the motor's may be smaller
    motor: MotorData | None = None  # None: one of the rated current
    response_s: tuple[float, float] = (0.0, 0.0)  # shortest and longest, from the request's last byte
    restart_s: float = 0.0  # silence while the device starts up
    settings: Mapping[int, int] = field(default_factory=dict)  # by register, beside the family's own
    slot: int = 1  # SSW900: where the RS-485 accessory sits
    coils: Mapping[int, bool] = field(default_factory=dict)  # SSW900: markers of a SoftPLC program (7.2.2)
    discrete_inputs: Mapping[int, bool] = field(default_factory=dict)
    is_configured: bool = True  # SST: coil 5
    flash_s: float = 0.3  # SST: until the configuration is stored


@dataclass(slots=True)
class Quirks:
    """The behaviour of this starter where the manuals leave it open; the defaults are ours."""

    keeps_run_command: bool = False  # it stands when the motor is stopped by something else, and acts later
    hides_command_bits: bool = False  # they read 0, whatever stands in them
    is_command_refused: bool = False  # erratum A-06: exception 3 for what is not set to serial, else nothing
    is_running_while_stopping: bool = False  # "running" stays 1 during the ramp down
    is_e28_resettable: bool = False  # erratum C-13, P313 = 5
    answers_before_restart: bool | None = None  # SSW-06 (4.3); None leaves it to chance
