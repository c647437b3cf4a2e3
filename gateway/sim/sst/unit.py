"""A simulated Intecma SST330i, SST360i or SST130i on the wire (rules ST-01 to ST-26)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

from gateway.errors import BadRequestError
from gateway.modbus.codes import ExceptionCode, Function
from gateway.modbus.pdu import encode_exception
from gateway.sim.core.power import MotorState
from gateway.sim.core.requests import refuse_address, refuse_function, refuse_value, word
from gateway.sim.sst import registers
from gateway.sim.sst.motion import CONFIGURE, RESET_ERRORS, RESET_STARTER, SINGLE_PHASE, START, SstMotion

MAX_FRAME = 54  # bytes, address and CRC included, both ways (NOTES)
COILS = range(26)  # coil n is at address n - 1

_WRITES = (Function.WRITE_COIL, Function.WRITE_REGISTER, Function.WRITE_REGISTERS)
_OVERHEAD = 3  # address and CRC around a PDU


class Sst(SstMotion):
    """One SST: coils and input registers in frames of 54 bytes at most."""

    functions: ClassVar[frozenset[int]] = frozenset({1, 4, 5, 6, 16})
    longest_gap_characters: ClassVar[float] = 1.5

    def __init__(self, address: int, **options: Any) -> None:
        self.fixed: dict[int, int] = {}  # registers that a test nails down
        super().__init__(address, **options)

    def _is_received(self, pdu: bytes) -> bool:
        return len(pdu) + _OVERHEAD <= MAX_FRAME

    def _checked_reply(self, reply: bytes) -> bytes | None:
        """Return exception 4 instead of what does not fit the memory (NOTES)."""
        if len(reply) + _OVERHEAD <= MAX_FRAME:
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
        if address + count - 1 > registers.LAST:
            raise refuse_address(registers.LAST + 1)
        readings = {**self._readings(), **self.settings, **self.fixed}
        wanted = range(address, address + count)
        missing = [register for register in wanted if register not in readings]
        if missing:
            raise refuse_address(missing[0])
        return [readings[register] for register in wanted]

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
        changes = dict(enumerate(words, address))
        writable = {*registers.OWN_NUMBERS, *registers.SETTINGS}
        if not self.is_configuring and writable & changes.keys():
            self._stop()  # the write is refused, and the motor is stopped too (register table)
            raise refuse_address(address)
        for register in changes:
            if register not in writable:
                raise refuse_address(register)
        stored = {
            register: value if register in registers.OWN_NUMBERS else value & 0xFF
            for register, value in changes.items()
        }
        for register, value in stored.items():
            lowest, highest = self.model.ranges.get(register, (0, 0xFFFF))
            if not lowest <= value <= highest:
                raise refuse_value(f"register {register}: {value} is not in {lowest}..{highest}")
        self._is_changed = self._is_changed or any(self.settings[each] != stored[each] for each in stored)
        self.settings.update(stored)

    def _coils(self) -> dict[int, bool]:
        """Return the coils that are no errors, by number."""
        return {
            1: self.is_start_set and not self.hides_command_bits,
            2: self.is_configuring,
            5: self.is_configured,
            6: True,
            7: self.control == "usb",
            8: self.control == "parallel",
            9: bool(self.errors),
            26: self._is_ready(),
        }

    def _readings(self) -> dict[int, int]:
        status = {
            MotorState.RAMP_UP: 1,
            MotorState.FULL_VOLTAGE: 2,
            MotorState.BYPASS: 2,
            MotorState.RAMP_DOWN: 3,
        }
        # The single-phase models show the stator current, which is higher than the total one (notes).
        current_a = self.meter.current_a * (1.2 if self.model.number == SINGLE_PHASE else 1.0)
        left_s = max(0, round(self._auto_reset_s - self.now_s)) if self._auto_reset_s else 0
        version, more_version = registers.version_words(self.firmware)
        readings = {
            0: self.model.number,
            1: registers.hardware_word(self.model.hardware),
            2: version,
            3: more_version,
            7: 0x0101,
            8: self.serial_number >> 16,
            9: self.serial_number & 0xFFFF,
            10: 0,
            11: 0,
            12: min(word(current_a), 0xFF),
            13: round(self.motor.heatsink_c) & 0xFF,
            14: word(self.motor.output_pct),
            15: left_s % 60,
            16: left_s // 60,
            17: 24,
            18: word(self.meter.line_voltage_v),
            19: status.get(self.motor.state, 0),
            registers.CAPACITOR_VOLTAGE: word(self.capacitor_v),
            21: 0,
        }
        if float(self.firmware) >= float(self.model.name_since):
            readings.update(zip(registers.NAME, registers.name_words(self.name), strict=True))
        return readings
