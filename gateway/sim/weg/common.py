"""The common part of the WEG starters: run, enable, jog, direction, local/remote, reset, from bits of a word.

The bits stand alike in VB03 (ssw06-es 4.2.3, ssw07 4.2.2) and S5.2.5/S5.2.6 (ssw900 S5.2).
"""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar

from gateway.families import Variant, decode
from gateway.sim.core.power import MotorState, MotorTrip
from gateway.sim.core.requests import refuse_value
from gateway.sim.core.setup import Quirks, Setup
from gateway.sim.core.unit import SimulatedUnit, Trip

RUN, ENABLE, JOG, REVERSE, REMOTE, RESET = 0x01, 0x02, 0x04, 0x08, 0x10, 0x80
ALL_COMMANDS = RUN | ENABLE | JOG | REVERSE | REMOTE | RESET

# The name of a trip of the motor's protections at a WEG starter, F or E: ssw900 C5.9.2, C5.2.2.1, C5.2.3.1,
# C5.1.1.1. The serial manuals of the others do not name these: ours, as of the SSW900.
FAULT_NUMBERS = {
    MotorTrip.OVERLOAD: 5,
    MotorTrip.OVERCURRENT: 66,
    MotorTrip.PHASE_LOSS: 74,
    MotorTrip.UNDERVOLTAGE: 2,
}

# Alike in all three: P220, P229, P230 (2.5-2.7), C3.1, C3.2, C3.3 (table A.2); C3.1 alone has 12.
MODE, LOCAL_SOURCE, REMOTE_SOURCE = 220, 229, 230
KEYPAD = 0  # as a source
REMOTE_AT_POWER_UP = (1, 3, 6, 8, 10, 12)  # as a mode

_MOTION = RUN | ENABLE | JOG | REVERSE


class Commanded(SimulatedUnit):
    """A starter whose motor is moved by a command word or by its keypad."""

    fault_code: ClassVar[str]  # how a fault is printed

    def __init__(self, address: int, setup: Setup, quirks: Quirks) -> None:
        super().__init__(address, setup, quirks)
        self.fault = 0  # the number of the latched one
        self.is_silence_shown = False  # the communication watchdog has acted
        self.is_remote = False
        self.command = 0  # the bits that stand
        self.is_enable_input_on = True  # a digital input set to general enable
        self.is_disabled = False  # by a general disable whose source has lost the control since
        self.is_reverse = False
        self.is_reversing = False

    # For people and tests

    def keypad_start(self) -> None:
        """Press start; it counts only while the keypad is the command source."""
        self._catch_up()
        if self.is_keypad_in_control:
            self.is_disabled = False
            if self._can_start():
                self._start_motor()

    def keypad_stop(self) -> None:
        """Press stop; it counts only while the keypad is the command source."""
        self._catch_up()
        if self.is_keypad_in_control:
            self._stop_motor()

    def set_enable_input(self, *, is_on: bool) -> None:
        """Switch a digital input that enables the starter; off lets the motor coast."""
        self._catch_up()
        self.is_enable_input_on = is_on
        if is_on:
            self._run_if_commanded()
        else:
            self._disable()

    def trip(self, number: int) -> None:
        """Show the fault of this number, E`number` or F`number`; the motor coasts."""
        self._catch_up()
        self._fail(number)

    def reset_at_keypad(self) -> None:
        """Reset any fault at the starter itself."""
        self._catch_up()
        if self.fault:
            self._clear_fault()

    def set_remote(self, *, is_remote: bool) -> None:
        """Switch local/remote by whatever key or input is there for it."""
        self._catch_up()
        self._set_remote(is_remote=is_remote)

    @property
    def is_fault(self) -> bool:
        """Whether a fault is latched."""
        return self.fault != 0

    def status_word(self) -> int:
        """Return the status word: bits that the profile names as points, as far as the firmware has them."""
        profile, variant = self.registers.profile, Variant(firmware=self.setup.firmware)
        flags = {name for name, is_set in self._flags().items() if is_set}
        return sum(
            1 << (point.bit or 0)
            for name, point in profile.points.items()
            if point.code == profile.status_word and name in flags
            if decode.is_there(profile, variant, point.source)
        )

    def _flags(self) -> dict[str, bool]:
        """Return what the status can say, by the name of its point."""
        motor = self.motor
        return {
            "running": self.is_running,
            "general_enabled": self.is_enabled,
            "jog": motor.state is MotorState.JOG,
            "accelerating": motor.state is MotorState.RAMP_UP,
            "current_limit": motor.is_current_limited,
            "full_voltage": motor.is_at_full_voltage,
            "bypass_closed": motor.state is MotorState.BYPASS,
            "decelerating": motor.state is MotorState.RAMP_DOWN,
            "remote": self.is_remote,
            "braking": motor.state is MotorState.BRAKING,
            "reversing": self.is_reversing,
            "reverse": self.is_reverse,
            "power_present": motor.has_all_phases,  # in all three phases (ssw06-es 4.2.2)
            "fault": self.is_fault,
        }

    # Defined by a family

    @property
    @abstractmethod
    def is_in_control(self) -> bool:
        """Whether the serial line is the command source in the present mode."""

    @property
    def is_keypad_in_control(self) -> bool:
        """Whether the keypad is."""
        return self._source() == KEYPAD

    def _source(self) -> int:
        return self.settings[REMOTE_SOURCE if self.is_remote else LOCAL_SOURCE]

    @property
    def is_operable(self) -> bool:
        """Whether the motor can be run at all: not in an adjusting mode."""
        return True

    @property
    def is_enabled(self) -> bool:
        """Whether general enable holds by all means.

        A general disable that takes the control away from the line holds until the line or the keypad enables
        again (not stated: ours).
        """
        is_commanded = not self.is_in_control or bool(self.command & ENABLE)
        return self.is_enable_input_on and is_commanded and not self.is_disabled

    @property
    def is_running(self) -> bool:
        """The value of the status bit "running"."""
        is_stopping = self.quirks.is_running_while_stopping and self.motor.state is MotorState.RAMP_DOWN
        return self.motor.is_turned_on or is_stopping

    @property
    def is_started(self) -> bool:
        """Whether a start was accepted and no stop since."""
        return self.motor.is_turned_on

    @abstractmethod
    def _may_switch_mode(self) -> bool:
        """Return whether the serial line decides about local and remote."""

    @abstractmethod
    def _is_start_delayed(self) -> bool:
        """Return whether a start would be ignored for now."""

    def _fail(self, number: int) -> None:
        """Latch a fault."""
        self.fault = number
        self.trips.append(Trip(self.now_s, self.fault_code.format(number)))
        self.motor.cut()
        self._stopped_otherwise()

    def _motor_tripped(self, cause: MotorTrip) -> None:
        self._fail(FAULT_NUMBERS[cause])

    def _clear_fault(self) -> None:
        """Carry out a reset."""
        self.fault = 0
        self._run_if_commanded()

    @abstractmethod
    def _timeout_s(self) -> float:
        """Return after how long without a telegram the watchdog acts; 0: it is off."""

    @abstractmethod
    def _miss_telegrams(self) -> None:
        """Do what the watchdog is set to do."""

    def _watch(self) -> None:
        """Count again from 0."""
        timeout_s = self._timeout_s()
        if timeout_s:
            self._at("watchdog", self.now_s + timeout_s, self._miss_telegrams)
        else:
            self._cancel("watchdog")

    def _forget(self) -> None:
        self.fault = 0
        self.is_silence_shown = self.is_disabled = False
        self._set_remote(is_remote=self.settings[MODE] in REMOTE_AT_POWER_UP)

    def _is_resettable(self) -> bool:
        """Return whether the present fault can be reset through the network."""
        return True

    def _start_motor(self) -> None:
        self.motor.start()

    def _stop_motor(self) -> None:
        self.is_reversing = False
        if self.motor.is_turned_on:
            self.motor.stop()

    @property
    def shown_command(self) -> int:
        """The command word as it reads back."""
        return 0 if self.quirks.hides_command_bits else self.command

    def _set_remote(self, *, is_remote: bool) -> None:
        self.is_remote = is_remote
        self.command = self.command | REMOTE if is_remote else self.command & ~REMOTE

    # Commands

    def _obey(self, values: int, mask: int) -> None:
        """Carry out the bits of `values` that `mask` names, as far as their source is set to serial."""
        was_in_control = self.is_in_control
        if mask & REMOTE and self._may_switch_mode():
            self._set_remote(is_remote=bool(values & REMOTE))
            self._run_if_commanded()
        if mask & RESET:
            self._obey_reset(is_on=bool(values & RESET))
        if mask & RUN and values & RUN and not self.is_started:
            self.start_frames.append(self.now_s)
        if not mask & _MOTION or not self.is_listening:  # a reset may have begun a restart
            return
        if not self.is_in_control:
            if was_in_control:
                self._stop_as_commanded(values, mask)
            elif self.quirks.is_command_refused:
                raise refuse_value("commands are not set to serial")
            self.command &= ~(RUN | JOG)
            return
        if mask & ENABLE:
            self._obey_enable(is_on=bool(values & ENABLE))
        if mask & REVERSE:
            self._obey_direction(is_reverse=bool(values & REVERSE))
        if mask & RUN:
            self._obey_run(is_on=bool(values & RUN))
        if mask & JOG:
            self._obey_jog(is_on=bool(values & JOG))

    def _stop_as_commanded(self, values: int, mask: int) -> None:
        """Stop for a word that takes the control away from the line and stops in one."""
        if mask & ~values & ENABLE:
            self.is_disabled = True
            self._disable()
        elif mask & ~values & RUN:
            self._stop_motor()

    def _obey_reset(self, *, is_on: bool) -> None:
        """Reset on the change from 0 to 1, and only in error."""
        is_rising = is_on and not self.command & RESET
        self.command = self.command | RESET if is_on else self.command & ~RESET
        if is_rising and self.is_fault and self._is_resettable():
            self._clear_fault()

    def _obey_enable(self, *, is_on: bool) -> None:
        if is_on:
            self.command |= ENABLE
            self.is_disabled = False
            self._run_if_commanded()
        else:
            self.command &= ~ENABLE
            self._disable()

    def _obey_run(self, *, is_on: bool) -> None:
        if not is_on:
            self.command &= ~RUN
            self._stop_motor()
        elif self.is_started:
            self.command |= RUN
        elif self._can_start():
            self.command |= RUN
            self.starts.append(self.now_s)
            self._start_motor()
        elif self.quirks.keeps_run_command and not self._is_start_delayed():
            self.command |= RUN

    def _obey_jog(self, *, is_on: bool) -> None:
        if is_on and self.motor.state is MotorState.STOPPED and self._can_start():
            self.command |= JOG
            self.motor.jog()
        elif not is_on:
            self.command &= ~JOG
            if self.motor.state is MotorState.JOG:
                self.motor.stop()

    def _obey_direction(self, *, is_reverse: bool) -> None:
        """Reverse the direction; a running motor first stops by ramp."""
        self.command = self.command | REVERSE if is_reverse else self.command & ~REVERSE
        if is_reverse == self.is_reverse:
            return
        if not self.motor.is_turned_on:
            self.is_reverse = is_reverse
            return
        self.is_reversing = True
        self.motor.stop()
        self._at("reversal", self.now_s + self.motor.ends_in_s, self._finish_reversal)

    def _finish_reversal(self) -> None:
        if self.is_reversing:
            self.is_reversing = False
            self.is_reverse = not self.is_reverse
            if self._can_start():
                self._start_motor()

    def _can_start(self) -> bool:
        is_possible = self.is_enabled and not self.is_fault and self.is_operable
        is_possible = is_possible and self.motor.is_mains_present and self.motor.state is not MotorState.JOG
        return is_possible and not self._is_start_delayed()

    def _disable(self) -> None:
        self.motor.cut()
        self._stopped_otherwise()

    def _stopped_otherwise(self) -> None:
        self.is_reversing = False
        if not self.quirks.keeps_run_command:
            self.command &= ~(RUN | JOG)

    def _run_if_commanded(self) -> None:
        """Start the motor for a run command that still stands."""
        stands = self.quirks.keeps_run_command and self.command & RUN
        if stands and self.is_in_control and self._can_start():
            self._start_motor()
