"""The common part of a simulated starter: time, silence, restarts, and requests by their function.

Pure: time comes in with each call, chance is seeded. A family adds its tables and its rules.
"""

from __future__ import annotations

import math
import random
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar

from gateway.errors import BadRequestError
from gateway.families import Table, Variant, load_profile
from gateway.modbus import EXCEPTION_BIT, Function, LineTiming, decode_request, encode_exception
from gateway.sim.core.meter import Meter
from gateway.sim.core.motor import Motor
from gateway.sim.core.power import MotorData, MotorTrip
from gateway.sim.core.registers import Registers
from gateway.sim.core.requests import RequestHandlers, refuse_function
from gateway.sim.core.setup import Quirks, Setup

_MOST_WRITES = 10_000


@dataclass(frozen=True, slots=True)
class Trip:
    """A fault, alarm or watchdog that acted."""

    at_s: float
    code: str  # as the manual prints it: E28, F128, A128, COIL12, R41


@dataclass(frozen=True, slots=True)
class RegisterWrite:
    """A write request that reached the starter, obeyed or not."""

    at_s: float
    pdu: bytes


class Lifetime:
    """The time up to which a starter has lived, and what is due when; a name has one appointment at most."""

    def __init__(self) -> None:
        self.now_s: float | None = None  # None: it has not begun
        self.silent_until_s = 0.0  # infinite without control supply
        self.appointments: dict[str, tuple[float, Callable[[], None]]] = {}

    def next_due(self, by_s: float) -> tuple[str, float, Callable[[], None]] | None:
        """Return the first appointment up to a time."""
        name = min(self.appointments, key=lambda each: self.appointments[each][0], default=None)
        if name is None or self.appointments[name][0] > by_s:
            return None
        return name, *self.appointments[name]


class SimulatedUnit(RequestHandlers, ABC):
    """One starter on a line; times are seconds on whatever clock the callers use."""

    family: ClassVar[str]
    table: ClassVar[Table] = Table.HOLDING
    delivered: ClassVar[Setup]  # as it comes, unless said otherwise
    longest_gap_characters: ClassVar[float] = 3.5  # silence inside a frame beyond which it is thrown away

    def __init__(self, address: int, setup: Setup, quirks: Quirks) -> None:
        self.address = address
        self.setup = setup
        self.quirks = quirks
        self.registers = Registers(load_profile(self.family), self.table, variant=Variant(model=setup.model))
        self.motor = Motor(setup.motor or MotorData(rated_current_a=setup.rated_current_a))
        self.meter = Meter(self.motor, seed=setup.seed)
        self.random = random.Random(setup.seed)
        self.clock: Callable[[], float] | None = None  # the line's, once the unit is on one
        self.starts: list[float] = []  # when a start was accepted over the line
        self.start_frames: list[float] = []  # when one was asked for, accepted or not
        self.writes: deque[RegisterWrite] = deque(maxlen=_MOST_WRITES)
        self.trips: list[Trip] = []
        self.handled = 0  # requests that this unit acted on
        self._joined: LineTiming | None = None
        self._life = Lifetime()

    @property
    def settings(self) -> dict[int, int]:
        """The settings that people have made, by register."""
        return self.registers.words

    @property
    def fixed(self) -> dict[int, int]:
        """Registers that a test nails down."""
        return self.registers.fixed

    # Requests of the line

    def handle(self, pdu: bytes, now_s: float) -> bytes | None:
        """Act on a request that came to this unit with a right CRC; None when there is no answer."""
        self.advance(now_s)
        if not self.is_listening or not self._is_received(pdu):
            return None
        self._on_request()
        self.handled += 1
        function = pdu[0] if pdu else 0
        try:
            if function not in self.registers.profile.limits.functions:
                raise refuse_function(f"function {function}")
            self._check_function(function)
            request = decode_request(pdu)
            if request.is_write:
                self.writes.append(RegisterWrite(now_s, pdu))
            reply = self.answer(request)
        except BadRequestError as error:
            reply = encode_exception(function & ~EXCEPTION_BIT, error.exception_code)
        return self._checked_reply(reply)

    def response_delay_s(self, pdu: bytes) -> float:
        """Return the time from this request's last byte to the reply's first."""
        shortest_s, longest_s = self._response_range_s(pdu)
        return self.random.uniform(shortest_s, longest_s)

    def longest_response_s(self, pdu: bytes) -> float:
        """Return the longest time that this request's reply may take to begin."""
        return self._response_range_s(pdu)[1]

    def listens_to(self, timing: LineTiming) -> bool:
        """Return whether speed and framing are the ones this unit is set to."""
        wanted = self._line_settings(timing)
        if self._joined is None or not wanted:
            return self._joined in (None, timing)
        return all(self.settings[register] == word for register, word in wanted.items())

    def join(self, timing: LineTiming) -> None:
        """Set speed and framing to those of the line it is put on, as at its installation."""
        self._joined = timing
        self.settings.update(self._line_settings(timing))

    def note_reception_error(self, *, is_crc: bool, byte_count: int) -> None:
        """Count a frame that was on the line, but could not be understood."""

    def advance(self, now_s: float) -> None:
        """Let time pass up to `now_s`: the motor moves, watchdogs act."""
        if self._life.now_s is None:
            self._life.now_s = now_s
            self._switched_on()
            return
        while (due := self._life.next_due(now_s)) is not None:
            name, due_s, action = due
            self._pass(due_s)
            del self._life.appointments[name]
            action()
        self._pass(now_s)

    # Actions of a person at the starter

    def power_off(self) -> None:
        """Take the control supply away: the motor coasts, the unit is silent."""
        self._catch_up()
        self._life.silent_until_s = math.inf
        self._life.appointments.clear()
        self.motor.cut()
        self._forget()

    def power_on(self) -> None:
        """Give the control supply back; the unit is silent until it has started up."""
        self._catch_up()
        self._start_up()

    def set_mains(self, *, is_present: bool) -> None:
        """Switch the supply of the power section; without it the motor coasts."""
        self._catch_up()
        self.motor.set_mains(is_present=is_present)
        if not is_present:
            self._stopped_otherwise()

    def set_line_voltage(self, percent: float, *, for_s: float = math.inf) -> None:
        """Give the supply another voltage, in percent of the rated one, for a time or until it is reset."""
        self._catch_up()
        self.motor.set_line_voltage(percent, for_s=for_s)

    def lose_phase(self, phase: int | None) -> None:
        """Interrupt phase 0, 1 or 2 (R, S, T) of the supply; None gives all of them back."""
        self._catch_up()
        self.motor.lost_phase = phase

    def change_motor(self, *, thermal_pct: float | None = None, **changes: float) -> None:
        """Change `load_pct`, `friction_pct`, the heat of the motor, or other fields of its `MotorData`."""
        self._catch_up()
        motor = self.motor
        heat_pct = motor.thermal_pct if thermal_pct is None else thermal_pct
        present = {"friction_pct": motor.friction_pct, "thermal_pct": heat_pct}
        motor.become(replace(motor.data, **{**present, **changes}))

    @abstractmethod
    def keypad_start(self) -> None:
        """Press start; it counts only while the starter itself is the command source."""

    @abstractmethod
    def keypad_stop(self) -> None:
        """Press stop; the same."""

    @abstractmethod
    def reset_at_keypad(self) -> None:
        """Reset any fault at the starter itself."""

    @abstractmethod
    def set_remote(self, *, is_remote: bool) -> None:
        """Give the commands to the line, or to the starter itself."""

    @abstractmethod
    def trip(self, number: int) -> None:
        """Let the fault with this number happen now."""

    @property
    def is_listening(self) -> bool:
        """Whether requests reach it: powered and started up."""
        return self.now_s >= self._life.silent_until_s

    @property
    def is_powered(self) -> bool:
        """Whether the control electronics are supplied."""
        return self._life.silent_until_s < math.inf

    @property
    def now_s(self) -> float:
        """The time up to which this unit has lived."""
        return self._life.now_s or 0.0

    # Added by a family

    def _line_settings(self, timing: LineTiming) -> dict[int, int]:  # noqa: ARG002
        """Return the settings that stand for a speed and framing; empty where none do."""
        return {}

    def _is_received(self, pdu: bytes) -> bool:  # noqa: ARG002
        """Return whether a request fits the unit's memory."""
        return True

    def _check_function(self, function: int) -> None:
        """Raise what answers a function that is served, but not now."""

    def _checked_reply(self, reply: bytes) -> bytes | None:
        """Return the reply as it is sent, if it is."""
        return reply

    def _on_request(self) -> None:
        """Take note of a valid telegram."""

    def _switched_on(self) -> None:
        """Begin to live."""

    def _forget(self) -> None:
        """Lose what is not stored without supply, and take up the state after switching on."""

    def _stopped_otherwise(self) -> None:
        """Forget a standing run command: the motor was stopped by something else."""

    @abstractmethod
    def _motor_tripped(self, cause: MotorTrip) -> None:
        """Show the fault for what the motor's protections found."""

    def _response_range_s(self, pdu: bytes) -> tuple[float, float]:
        """Return the stated times; those of FC16 may be no range, but so long for each register."""
        each_s = self.registers.profile.timing.write_per_register_s
        if not each_s or pdu[:1] != bytes((Function.WRITE_REGISTERS,)):
            return self.setup.response_s
        written_s = each_s * max(int.from_bytes(pdu[3:5], "big"), 1)
        return written_s, written_s

    # Below the surface

    def _restart(self) -> None:
        """Restart the whole device: the motor coasts, what is not stored is lost, requests are ignored."""
        self.motor.cut()
        self._life.appointments.clear()
        self._forget()
        self._start_up()

    def _start_up(self) -> None:
        self._life.silent_until_s = self.now_s + self.setup.restart_s
        self._switched_on()

    def _catch_up(self) -> None:
        """Simulate up to the line's present time, before a change from outside."""
        if self.clock is not None:
            self.advance(self.clock())
        elif self._life.now_s is None:
            self.advance(0.0)

    def _at(self, name: str, due_s: float, action: Callable[[], None]) -> None:
        """Do something once the time comes; a name has one appointment at most."""
        self._life.appointments[name] = (due_s, action)

    def _cancel(self, name: str) -> None:
        self._life.appointments.pop(name, None)

    def _pass(self, until_s: float) -> None:
        step_s = until_s - self.now_s
        if step_s <= 0:
            return
        self.motor.step(step_s)
        self._life.now_s = until_s
        if self.motor.trip is not None:
            cause, self.motor.trip = self.motor.trip, None
            self._motor_tripped(cause)
