"""The motion of a simulated SST: initialisation, start and stop, errors, watchdogs.

Where the text of the manual (sst-intecma) leaves it open, the stricter reading is taken.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import ClassVar, Literal

from gateway.families import Table
from gateway.sim.core.power import MotorData, MotorTrip
from gateway.sim.core.requests import refuse_address
from gateway.sim.core.setup import Quirks, Setup
from gateway.sim.core.unit import SimulatedUnit, Trip
from gateway.sim.sst import registers

START, CONFIGURE, RESET_ERRORS, RESET_STARTER = range(4)  # addresses of the coils that can be written
ERROR_COILS = range(10, 22)  # coil numbers that name an error; coil 9 is any of them
COIL_OVERCURRENT = 12
_COILS = {
    MotorTrip.OVERCURRENT: COIL_OVERCURRENT,
    MotorTrip.OVERLOAD: 13,  # overtemperature: it names no overload
    MotorTrip.UNDERVOLTAGE: 14,
    MotorTrip.PHASE_LOSS: 17,
}
SINGLE_PHASE = 130

# Start capacitor: full, empty, time constant of its discharge; all ours.
_CHARGED_V, _DISCHARGED_V, _DISCHARGE_S = 325.0, 10.0, 2.0
_DISCHARGED_AFTER_S = _DISCHARGE_S * math.log(_CHARGED_V / _DISCHARGED_V)

Control = Literal["modbus", "usb", "parallel"]


class SstMotion(SimulatedUnit):
    """One SST; initialised (coils 5 and 26 are 1) unless `is_configured` is False."""

    family: ClassVar[str] = "sst"
    table: ClassVar[Table] = Table.INPUT
    delivered: ClassVar[Setup] = Setup(
        model="SST330i-M",
        motor=MotorData(rated_current_a=20.0, load_pct=70.0),
        response_s=(0.010, 0.050),
        restart_s=2.0,
    )

    def __init__(self, address: int, setup: Setup, quirks: Quirks) -> None:
        super().__init__(address, setup, quirks)
        self.model = registers.find_model(setup.model)
        self.is_configured = setup.is_configured  # coil 5
        self.is_configuring = False  # coil 2
        self.is_start_set = False  # coil 1
        self.errors: set[int] = set()  # numbers of the coils 10-21 that are 1
        self.control: Control = "modbus"
        self.flash_writes = 0  # configurations that were really written
        self.settings.update({**dict.fromkeys(self.settings, 0), **self.model.first_values, **setup.settings})
        self._is_changed = False
        self._charged_until_s = -math.inf
        self._auto_reset_s = 0.0
        self._take_up_settings()

    @property
    def firmware(self) -> str:
        """Its software version."""
        return self.setup.firmware or self.model.firmware

    # For people and tests

    def trip(self, number: int) -> None:
        """Set error coil `number` (10-21); the motor coasts."""
        self._catch_up()
        self._fail(number)

    def reset_at_keypad(self) -> None:
        """Clear all errors by what the starter itself has for it."""
        self._catch_up()
        self._clear_errors()

    def set_remote(self, *, is_remote: bool) -> None:
        """Give control to Modbus, or to the parallel input."""
        self.set_control("modbus" if is_remote else "parallel")

    def set_control(self, control: Control) -> None:
        """Give control to USB (coil 7), the parallel input (coil 8) or back to Modbus."""
        self._catch_up()
        self.control = control

    def keypad_start(self) -> None:
        """Start through USB or the parallel input, whichever controls."""
        self._catch_up()
        if self.control != "modbus" and self._is_ready() and not self.errors:
            self._start()

    def keypad_stop(self) -> None:
        """Stop through it; the motor then stays stopped, also when another source takes control."""
        self._catch_up()
        if self.control != "modbus":
            self._stop()

    @property
    def is_writing_flash(self) -> bool:
        """Whether the configuration is being stored: writes get exception 6 (when it comes is ours; E-03)."""
        return "flash" in self._life.appointments

    @property
    def capacitor_v(self) -> float:
        """The voltage of the start capacitor; 0 on three-phase models."""
        if self.model.number != SINGLE_PHASE:
            return 0.0
        past_s = max(0.0, self.now_s - self._charged_until_s)
        return _CHARGED_V * math.exp(-past_s / _DISCHARGE_S)

    # Commands

    def _obey_start(self, *, is_on: bool) -> None:
        if not is_on:
            self._stop()
            return
        if not self.motor.is_turned_on:
            self.start_frames.append(self.now_s)
        if not self.is_configured:
            raise refuse_address(START)
        if not self._is_ready() or self.errors or self.is_start_set:
            return  # what is answered is not stated: ours looks like success
        self.is_start_set = True
        self.starts.append(self.now_s)
        self._start()

    def _obey_configure(self, *, is_on: bool) -> None:
        if is_on and not self.is_configuring:
            self._stop()
            self.is_configuring = True
            self.is_configured = False
            self._is_changed = False
        elif not is_on and self.is_configuring:
            self.is_configuring = False
            self._at("flash", self.now_s + self.setup.flash_s, self._finish_configuration)

    def _finish_configuration(self) -> None:
        self.is_configured = True
        self.flash_writes += self._is_changed
        self._take_up_settings()

    def _take_up_settings(self) -> None:
        self.motor.data = replace(
            self.motor.data,
            ramp_up_s=8.0 / max(1, self.settings[registers.ACCELERATION]),
            ramp_down_s=self.settings[registers.DECELERATION] / 10,
        )

    def _start(self) -> None:
        """Start, on single-phase models once the capacitor is discharged (notes)."""
        discharged_s = self._charged_until_s + _DISCHARGED_AFTER_S
        if self.model.number == SINGLE_PHASE and self.now_s < discharged_s:
            self._at("start", discharged_s, self._switch_on)
        else:
            self._switch_on()

    def _switch_on(self) -> None:
        self.motor.start()
        self._charged_until_s = self.now_s + self.motor.data.ramp_up_s

    def _stop(self) -> None:
        self.is_start_set = False
        self._cancel("start")
        self._charged_until_s = min(self._charged_until_s, self.now_s)
        self.motor.stop()

    def _is_ready(self) -> bool:
        """Return coil 26."""
        return self.motor.is_mains_present and self.is_configured

    # Errors and watchdogs

    def _on_request(self) -> None:
        """Restart both timeouts (notes on registers 41 and 42).

        Whether they run before the first command after a start-up is not stated. Here they do not: with
        register 42 at 1 s a starter could never be reached again.
        """
        for register, action in (
            (registers.TIMEOUT_STOP, self._miss_commands),
            (registers.TIMEOUT_RESET, self._miss_commands_long),
        ):
            if self.settings[register]:
                self._at(f"R{register}", self.now_s + self.settings[register], action)
            else:
                self._cancel(f"R{register}")

    def _miss_commands(self) -> None:
        self.trips.append(Trip(self.now_s, "R41"))
        self._stop()

    def _miss_commands_long(self) -> None:
        self.trips.append(Trip(self.now_s, "R42"))
        self._restart()

    def _fail(self, number: int) -> None:
        if number not in ERROR_COILS:
            raise ValueError(f"coil {number} names no error")
        self.errors.add(number)
        self.trips.append(Trip(self.now_s, f"COIL{number}"))
        was_set = self.is_start_set
        self._stop()
        self.is_start_set = was_set and self.quirks.keeps_run_command
        self.motor.cut()
        minutes = self.settings[registers.AUTO_RESET]
        if minutes != registers.AUTO_RESET_OFF:
            self._auto_reset_s = self.now_s + 60 * minutes
            self._at("auto-reset", self._auto_reset_s, self._clear_errors)

    def _clear_errors(self) -> None:
        self.errors.clear()
        self._auto_reset_s = 0.0
        self._cancel("auto-reset")
        if self.is_start_set and self.quirks.keeps_run_command and self._is_ready():
            self._start()

    def _motor_tripped(self, cause: MotorTrip) -> None:
        self._fail(_COILS[cause])

    def _stopped_otherwise(self) -> None:
        self._stop()

    def _forget(self) -> None:
        self.is_start_set = False
        self.is_configuring = False
        self.is_configured = False  # the initialisation has to be done again (ST-07)
        self._clear_errors()
