"""A simulated Intecma SST330i, SST360i or SST130i on the wire (rules ST-01 to ST-26)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from gateway.errors import BadRequestError
from gateway.families import Type
from gateway.modbus import ExceptionCode, Function, encode_exception
from gateway.sim.core.power import MotorState
from gateway.sim.core.registers import Measured
from gateway.sim.core.requests import refuse_address, refuse_function
from gateway.sim.sst import registers
from gateway.sim.sst.motion import CONFIGURE, RESET_ERRORS, RESET_STARTER, SINGLE_PHASE, START, SstMotion

COILS = range(26)  # coil n is at address n - 1

_WRITES = (Function.WRITE_COIL, Function.WRITE_REGISTER, Function.WRITE_REGISTERS)
LOW_BYTE = (Type.LOW_U8, Type.LOW_ENUM)
_OVERHEAD = 3  # address and CRC around a PDU


class Sst(SstMotion):
    """One SST: coils and input registers in frames of 54 bytes at most."""

    longest_gap_characters: ClassVar[float] = 1.5

    def _is_received(self, pdu: bytes) -> bool:
        return len(pdu) + _OVERHEAD <= self.registers.profile.limits.frame_bytes

    def _checked_reply(self, reply: bytes) -> bytes | None:
        """Return exception 4 instead of what does not fit the memory (NOTES)."""
        if len(reply) + _OVERHEAD <= self.registers.profile.limits.frame_bytes:
            return reply
        return encode_exception(reply[0], ExceptionCode.SERVER_DEVICE_FAILURE)

    def _check_function(self, function: int) -> None:
        if function in _WRITES and self.control != "modbus":
            raise refuse_function(f"{self.control} is in control")
        if function in _WRITES and self.is_writing_flash:
            raise BadRequestError("the flash is being written", ExceptionCode.SERVER_DEVICE_BUSY)

    def _read_coils(self, address: int, count: int) -> Sequence[bool]:
        if not (address in COILS and address + count - 1 in COILS):
            raise refuse_address(address)
        ones = {number for number, is_set in self._coils().items() if is_set} | self.errors
        return [number in ones for number in range(address + 1, address + 1 + count)]

    def _read_registers(self, address: int, count: int) -> Sequence[int]:
        measured, wanted = self._readings(), range(address, address + count)
        has_name = float(self.firmware) >= float(self.model.name_since)
        for register in wanted:
            row = self.registers.owners.get(register)
            if row is None or (row.code in registers.NAME and not has_name):
                raise refuse_address(register)
        return [self.registers.word(register, measured) for register in wanted]

    def _write_coils(self, address: int, bits: Sequence[bool]) -> None:
        (is_on,) = bits
        if address == START:
            self._obey_start(is_on=is_on)
        elif address == CONFIGURE:
            self._obey_configure(is_on=is_on)
        elif address == RESET_ERRORS:
            if is_on:
                self._clear_errors()
        elif address == RESET_STARTER:
            if is_on:
                self._restart()
        else:
            raise refuse_address(address)

    def _write_registers(self, address: int, words: Sequence[int]) -> None:
        rows = [self.registers.owners.get(address + place) for place in range(len(words))]
        writable = [row for row in rows if row is not None and row.is_configuration]
        if writable and not self.is_configuring:
            self._stop()  # the write is refused, and the motor is stopped too (register table)
        if not self.is_configuring or len(writable) < len(words):
            raise refuse_address(address)
        for row, value in zip(writable, words, strict=True):
            self.registers.check(row, (value,))
        before = dict(self.settings)
        for row, value in zip(writable, words, strict=True):  # of 30 to 42 only the low byte counts
            self.registers.hold(row, (value & 0xFF if row.type in LOW_BYTE else value,))
        self._is_changed = self._is_changed or self.settings != before

    def _coils(self) -> dict[int, bool]:
        """Return the coils that are no errors, by number."""
        return {
            1: self.is_start_set and not self.quirks.hides_command_bits,
            2: self.is_configuring,
            5: self.is_configured,
            6: True,
            7: self.control == "usb",
            8: self.control == "parallel",
            9: bool(self.errors),
            26: self._is_ready(),
        }

    def _readings(self) -> Measured:
        status = {
            MotorState.RAMP_UP: 1,
            MotorState.FULL_VOLTAGE: 2,
            MotorState.BYPASS: 2,
            MotorState.RAMP_DOWN: 3,
        }
        # The single-phase models show the stator current, which is higher than the total one (notes).
        left_s = max(0, round(self._auto_reset_s - self.now_s)) if self._auto_reset_s else 0
        versions = registers.version_words(self.firmware)
        serial_number = self.setup.serial_number or 500_000 + self.setup.seed
        names = registers.name_words(self.setup.model)
        return {
            "R0": self.model.number,
            "R1": (registers.hardware_word(self.model.hardware),),
            "R2": versions[:1],
            "R3": versions[1:],
            "R7": (0x0101,),
            "R8": serial_number >> 16,
            "R9": serial_number & 0xFFFF,
            "R12": self.meter.current_a * (1.2 if self.model.number == SINGLE_PHASE else 1.0),
            "R13": self.motor.heatsink_c,
            "R14": self.motor.output_pct,
            "R15": left_s % 60,
            "R16": left_s // 60,
            "R17": 24,
            "R18": self.meter.line_voltage_v,
            "R19": status.get(self.motor.state, 0),
            "R20": self.capacitor_v,
            **{code: (word,) for code, word in zip(registers.NAME, names, strict=True)},
        }
