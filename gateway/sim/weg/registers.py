"""The registers and coils of a simulated SSW-06 or SSW-07: Pnnn at nnn, VBnn at 5000 + nn.

Sections are those of ssw06-es and ssw07-ssw08; S6-xx and S7-xx are alike unless a subclass says otherwise.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

from gateway.modbus.timing import LineTiming
from gateway.sim.core.power import MotorState
from gateway.sim.core.requests import refuse_address, refuse_value
from gateway.sim.weg.command_sources import (
    OUTPUT_BY_SERIAL,
    P_ADDRESS,
    P_LOCAL_REMOTE,
    P_LOCAL_SOURCE,
    P_REMOTE_SOURCE,
    P_SERIAL,
    P_TIMEOUT,
    Supervised,
)

VB00, VB01, VB03, VB06, VB07, VB08, VB09, VB10 = 5000, 5001, 5003, 5006, 5007, 5008, 5009, 5010

COMMAND_COILS = range(100, 108)  # VB03 bits 0-7 (5.3.2)
STATUS_COILS = range(16)  # VB01

_SERIAL_SETTINGS = {  # P312 (2.2)
    (baud, framing): 3 * row + column + 1
    for row, baud in enumerate((9600, 19200, 38400))
    for column, framing in enumerate(("8N2", "8O1", "8E1"))
}


class BasicVariables(Supervised):
    """An SSW-06 or SSW-07 on the wire."""

    functions: ClassVar[frozenset[int]] = frozenset({1, 3, 5, 6, 15, 16, 43})  # 5.3.1
    product_name: ClassVar[str]
    outputs: ClassVar[Mapping[int, int]]  # relay bit of VB08 -> parameter of its function

    def __init__(self, address: int, *, product: str = "", **options: Any) -> None:
        self.product = product or self.product_name
        self.fixed: dict[int, int] = {}  # registers that a test nails down
        self.relays = 0  # VB08 as far as the relays follow it
        super().__init__(address, **options)

    def listens_to(self, timing: LineTiming) -> bool:
        """Return whether P312 stands as when the unit was put on a line of this timing (2.2)."""
        if self._joined is None:
            return True
        code = _SERIAL_SETTINGS.get((timing.baud, str(timing.framing)))
        return timing == self._joined if code is None else code == self.settings[P_SERIAL]

    def join(self, timing: LineTiming) -> None:
        """Set P312 to the line's speed and framing."""
        super().join(timing)
        code = _SERIAL_SETTINGS.get((timing.baud, str(timing.framing)))
        self.settings[P_SERIAL] = code or self.settings[P_SERIAL]

    def _common_status(self) -> int:
        """Return the bits of VB01 that both families have (4.2.1, 4.2.2)."""
        motor = self.motor
        flags = {
            0: self.is_running,
            1: self.is_enabled,
            2: motor.state is MotorState.JOG,
            3: motor.state is MotorState.RAMP_UP,
            4: motor.is_current_limited,
            5: motor.is_at_full_voltage,
            7: motor.state is MotorState.RAMP_DOWN,
            8: self.is_remote,
            9: motor.state is MotorState.BRAKING,
            10: self.is_reversing,
            11: self.is_reverse,
            12: motor.state is MotorState.BYPASS,
            14: motor.has_all_phases,  # in all three phases (ssw06-es 4.2.2)
            15: self.is_fault,
        }
        return sum(1 << bit for bit, is_set in flags.items() if is_set)

    def _state_number(self) -> int:
        """Return P006 (programming manual 0899.5665/05)."""
        if self.is_fault:
            return 2
        if not self.is_enabled:
            return 12
        numbers = {
            MotorState.RAMP_UP: 3,
            MotorState.FULL_VOLTAGE: 5,
            MotorState.BYPASS: 5,
            MotorState.RAMP_DOWN: 7,
        }
        return numbers.get(self.motor.state, 11 if self._is_start_delayed() else 0)

    # Requests

    def _read_coils(self, address: int, count: int) -> Sequence[bool]:
        status, commands = self.status_word(), self.shown_command
        bits = []
        for coil in range(address, address + count):
            if coil in STATUS_COILS:
                bits.append(bool(status >> coil & 1))
            elif coil in COMMAND_COILS:
                bits.append(bool(commands >> coil - COMMAND_COILS.start & 1))
            else:
                raise refuse_address(coil)
        return bits

    def _write_coils(self, address: int, bits: Sequence[bool]) -> None:
        values = mask = 0
        for coil, is_on in enumerate(bits, address):
            if coil in STATUS_COILS:
                raise refuse_value("status bits are read-only")
            if coil not in COMMAND_COILS:
                raise refuse_address(coil)
            bit = 1 << coil - COMMAND_COILS.start
            mask |= bit
            values |= bit if is_on else 0
        self._obey(values, mask)

    def _read_registers(self, address: int, count: int) -> Sequence[int]:
        if (address, count) == (VB01, 1):  # most requests are for it alone
            self.meter.pass_time()
            return [self._register(VB01, {VB01: self.status_word()})]
        readings = self._readings()
        return [self._register(number, readings) for number in range(address, address + count)]

    def _write_registers(self, address: int, words: Sequence[int]) -> None:
        for number, value in enumerate(words, address):
            self._check_write(number, value)
        for number, value in enumerate(words, address):
            self._write(number, value)

    def _register(self, number: int, readings: Mapping[int, int]) -> int:
        if number in self.fixed:
            return self.fixed[number]
        if number in self.settings:
            return self.settings[number]
        if number not in readings:
            raise refuse_address(number)
        return readings[number]

    def _check_write(self, number: int, value: int) -> None:
        lowest, highest = self.limits.get(number, (0, 0xFFFF))
        if number not in self.limits and number not in (0, *self._writable_variables()):
            known = number in self.settings or number in self._readings()
            raise refuse_value("read-only") if known else refuse_address(number)
        if not lowest <= value <= highest:
            raise refuse_value(f"{value} is not in {lowest}..{highest}")

    def _write(self, number: int, value: int) -> None:
        if number == VB03:
            self._write_command_word(value)
        elif number == VB08:
            driven = [bit for bit, row in self.outputs.items() if self.settings[row] == OUTPUT_BY_SERIAL]
            self.relays = value & sum(1 << bit for bit in driven)
        elif number in self.limits:  # P000 is taken and forgotten (4.3)
            self.settings[number] = value
            self._setting_changed(number, value)

    def _setting_changed(self, number: int, value: int) -> None:
        if number == P_ADDRESS:
            self.address = value
        elif number == P_TIMEOUT:
            self._watch()
        elif number == P_LOCAL_REMOTE and value in (0, 1):
            self._set_remote(is_remote=value == 1)
        if number in (P_LOCAL_REMOTE, P_LOCAL_SOURCE, P_REMOTE_SOURCE):
            self._run_if_commanded()

    def _writable_variables(self) -> tuple[int, ...]:
        return (VB03, VB08)

    @abstractmethod
    def status_word(self) -> int:
        """Return VB01."""

    @abstractmethod
    def _write_command_word(self, value: int) -> None:
        """Obey VB03."""

    @abstractmethod
    def _readings(self) -> Mapping[int, int]:
        """Return what can only be read."""

    def _identification(self) -> dict[int, str]:
        return {0: "WEG", 1: f"{self.product} {self.rated_current_a:.1f}A", 2: f"V{self.firmware}"}

    def _response_range_s(self, pdu: bytes) -> tuple[float, float]:
        """Return the times of 5.3.1: those of FC16 are no range, but so long for each register."""
        shortest_s, longest_s = self.response_s
        if pdu[:1] == b"\x10":
            written_s = longest_s * max(int.from_bytes(pdu[3:5], "big"), 1)
            return written_s, written_s
        return shortest_s, longest_s

    def _clear_outputs(self) -> None:
        self.relays = 0
