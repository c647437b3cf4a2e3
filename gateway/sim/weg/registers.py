"""The registers and coils of a simulated SSW-06 or SSW-07: Pnnn at nnn, VBnn at 5000 + nn.

Sections are those of ssw06-es and ssw07-ssw08; S6-xx and S7-xx are alike unless a subclass says otherwise.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence

from gateway.families import Table
from gateway.modbus import LineTiming
from gateway.sim.core.power import MotorState
from gateway.sim.core.registers import is_writable
from gateway.sim.core.requests import refuse_address, refuse_value
from gateway.sim.core.setup import Quirks, Setup
from gateway.sim.weg.command_sources import (
    OUTPUT_BY_SERIAL,
    P_ADDRESS,
    P_SERIAL,
    P_TIMEOUT,
    Supervised,
)
from gateway.sim.weg.common import LOCAL_SOURCE, MODE, REMOTE_SOURCE

VB03, VB08 = 5003, 5008


class BasicVariables(Supervised):
    """An SSW-06 or SSW-07 on the wire."""

    def __init__(self, address: int, setup: Setup, quirks: Quirks) -> None:
        self.relays = 0  # VB08 as far as the relays follow it
        super().__init__(address, setup, quirks)

    def _line_settings(self, timing: LineTiming) -> dict[int, int]:
        """Return P312: three byte formats at each rate, in the profile's order (2.2)."""
        profile, framing = self.registers.profile, str(timing.framing)
        if timing.baud not in profile.bauds or framing not in profile.framings:
            return {}
        return {P_SERIAL: 3 * profile.bauds.index(timing.baud) + profile.framings.index(framing) + 1}

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
        words = {"VB01": self.status_word(), "VB03": self.shown_command}
        bits = [self._bit(coil) for coil in range(address, address + count)]
        return [bool(words[word] >> bit & 1) for word, bit in bits]

    def _write_coils(self, address: int, bits: Sequence[bool]) -> None:
        values = mask = 0
        for coil, is_on in enumerate(bits, address):
            word, bit = self._bit(coil)
            if word != "VB03":
                raise refuse_value("status bits are read-only")
            mask |= 1 << bit
            values |= is_on << bit
        self._obey(values, mask)

    def _bit(self, coil: int) -> tuple[str, int]:
        """Return the word and the bit that a coil is (5.3.2)."""
        rows = self.registers.profile.rows_at.get((Table.COIL, coil))
        if rows is None:
            raise refuse_address(coil)
        word, _, bit = rows[0].code.partition(".")
        return word, int(bit)

    def _read_registers(self, address: int, count: int) -> Sequence[int]:
        measured = {**self._electric(), **self._readings()}
        try:
            return [self.registers.word(number, measured) for number in range(address, address + count)]
        except KeyError as error:
            raise refuse_address(error.args[0]) from error

    def _write_registers(self, address: int, words: Sequence[int]) -> None:
        for number, value in enumerate(words, address):
            self._check_write(number, value)
        for number, value in enumerate(words, address):
            self._write(number, value)

    def _check_write(self, number: int, value: int) -> None:
        row = self.registers.owners.get(number)
        if row is None:
            raise refuse_address(number)
        if not is_writable(row):
            raise refuse_value("read-only")
        self.registers.check(row, (value,))

    def _write(self, number: int, value: int) -> None:
        if number == VB03:
            self._write_command_word(value)
        elif number == VB08:
            outputs = self.registers.profile.outputs.values()
            function = {1 << each.bit: int(each.function[1:]) for each in outputs if each.bit is not None}
            self.relays = value & sum(b for b, p in function.items() if self.settings[p] == OUTPUT_BY_SERIAL)
        elif number != 0:  # P000 is taken and forgotten (4.3)
            self.settings[number] = value
            self._setting_changed(number, value)

    def _setting_changed(self, number: int, value: int) -> None:
        if number == P_ADDRESS:
            self.address = value
        elif number == P_TIMEOUT:
            self._watch()
        elif number == MODE and value in (0, 1):
            self._set_remote(is_remote=value == 1)
        if number in (MODE, LOCAL_SOURCE, REMOTE_SOURCE):
            self._run_if_commanded()

    @abstractmethod
    def _write_command_word(self, value: int) -> None:
        """Obey VB03."""

    def _electric(self) -> dict[str, float]:
        """Return what both families measure."""
        meter = self.meter
        currents = zip(("P030", "P031", "P032"), meter.phase_currents_a, strict=True)
        return {
            "P002": meter.current_pct,
            "P003": meter.current_a,
            "P006": self._state_number(),
            "P011": meter.apparent_kva,
            **dict(currents),
            "P295": self.setup.rated_current_a,
            "VB01": self.status_word(),
            "VB03": self.shown_command,
            "VB08": self.relays,
        }

    @abstractmethod
    def _readings(self) -> Mapping[str, float]:
        """Return what only this family measures."""

    def _identification(self) -> dict[int, str]:
        setup = self.setup
        return {0: "WEG", 1: f"{setup.product} {setup.rated_current_a:.1f}A", 2: f"V{setup.firmware}"}

    def _clear_outputs(self) -> None:
        self.relays = 0
