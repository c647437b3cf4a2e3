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
from gateway.modbus.codes import EXCEPTION_BIT
from gateway.modbus.pdu import encode_exception
from gateway.modbus.server import decode_request
from gateway.modbus.timing import LineTiming
from gateway.sim.core.meter import Meter
from gateway.sim.core.motor import Motor
from gateway.sim.core.power import MotorData, MotorTrip
from gateway.sim.core.requests import RequestHandlers, refuse_function

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


class SimulatedUnit(RequestHandlers, ABC):
    """One starter on a line; times are seconds on whatever clock the callers use."""

    family: ClassVar[str]
    longest_gap_characters: ClassVar[float] = 3.5  # silence inside a frame beyond which it is thrown away

    def __init__(
        self,
        address: int,
        *,
        seed: int = 0,
        motor: MotorData | None = None,
        response_s: tuple[float, float],
        restart_s: float,
    ) -> None:
        self.address = address
        self.motor = Motor(motor)
        self.meter = Meter(self.motor, seed=seed)
        self.random = random.Random(seed)
        self.response_s = response_s  # shortest and longest, from the request's last byte
        self.restart_s = restart_s  # silence while the device starts up
        self.is_powered = True  # the control electronics
        self.clock: Callable[[], float] | None = None  # the line's, once the unit is on one
        self.starts: list[float] = []  # when a start was accepted over the line
        self.start_frames: list[float] = []  # when one was asked for, accepted or not
        self.writes: deque[RegisterWrite] = deque(maxlen=_MOST_WRITES)
        self.trips: list[Trip] = []
        self.handled = 0  # requests that this unit acted on
        self._joined: LineTiming | None = None
        self._now_s: float | None = None
        self._silent_until_s = 0.0
        self._timers: dict[str, tuple[float, Callable[[], None]]] = {}

    # What the line asks

    def handle(self, pdu: bytes, now_s: float) -> bytes | None:
        """Act on a request that came to this unit with a right CRC; None when there is no answer."""
        self.advance(now_s)
        if not self.is_listening or not self._is_received(pdu):
            return None
        self._on_request()
        self.handled += 1
        function = pdu[0] if pdu else 0
        try:
            if function not in self.functions:
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
        return self._joined in (None, timing)

    def join(self, timing: LineTiming) -> None:
        """Set speed and framing to those of the line it is put on, as at its installation."""
        self._joined = timing

    def note_reception_error(self, *, is_crc: bool, byte_count: int) -> None:
        """Count a frame that was on the line, but could not be understood."""

    def advance(self, now_s: float) -> None:
        """Let time pass up to `now_s`: the motor moves, watchdogs act."""
        if self._now_s is None:
            self._now_s = now_s
            self._switched_on()
            return
        while self._timers:
            name = min(self._timers, key=lambda each: self._timers[each][0])
            due_s, action = self._timers[name]
            if due_s > now_s:
                break
            self._pass(due_s)
            del self._timers[name]
            action()
        self._pass(now_s)

    # What a person at the starter can do

    def power_off(self) -> None:
        """Take the control supply away: the motor coasts, the unit is silent."""
        self._catch_up()
        self.is_powered = False
        self._timers.clear()
        self.motor.cut()
        self._forget()

    def power_on(self) -> None:
        """Give the control supply back; the unit is silent until it has started up."""
        self._catch_up()
        self.is_powered = True
        self._start_up()

    def set_mains(self, *, is_present: bool) -> None:
        """Switch the supply of the power section; without it the motor coasts."""
        self._catch_up()
        self.motor.set_mains(is_present=is_present)
        if not is_present:
            self._stopped_otherwise()

    def set_line_voltage(self, percent: float, *, for_s: float = math.inf) -> None:
        """Let the supply have another voltage, in percent of the rated one, for a time or until set anew."""
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
        present = {"load_pct": motor.load_pct, "friction_pct": motor.friction_pct}
        heat_pct = motor.thermal_pct if thermal_pct is None else thermal_pct
        motor.become(replace(motor.data, **{**present, "thermal_pct": heat_pct, **changes}))

    @abstractmethod
    def trip(self, number: int) -> None:
        """Let the fault with this number happen now."""

    @property
    def is_listening(self) -> bool:
        """Whether requests reach it: powered and started up."""
        return self.is_powered and self.now_s >= self._silent_until_s

    @property
    def now_s(self) -> float:
        """The time up to which this unit has lived."""
        return 0.0 if self._now_s is None else self._now_s

    # What a family adds

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

    def _response_range_s(self, pdu: bytes) -> tuple[float, float]:  # noqa: ARG002
        return self.response_s

    # Below the surface

    def _restart(self) -> None:
        """Restart the whole device: the motor coasts, what is not stored is lost, requests are ignored."""
        self.motor.cut()
        self._timers.clear()
        self._forget()
        self._start_up()

    def _start_up(self) -> None:
        self._silent_until_s = self.now_s + self.restart_s
        self._switched_on()

    def _catch_up(self) -> None:
        """Simulate up to the line's present time, before a change from outside."""
        if self.clock is not None:
            self.advance(self.clock())
        elif self._now_s is None:
            self.advance(0.0)

    def _at(self, name: str, due_s: float, action: Callable[[], None]) -> None:
        """Do something once the time comes; a name has one appointment at most."""
        self._timers[name] = (due_s, action)

    def _cancel(self, name: str) -> None:
        self._timers.pop(name, None)

    def _pass(self, until_s: float) -> None:
        step_s = until_s - self.now_s
        if step_s <= 0:
            return
        self.motor.step(step_s)
        self._now_s = until_s
        if self.motor.trip is not None:
            cause, self.motor.trip = self.motor.trip, None
            self._motor_tripped(cause)
