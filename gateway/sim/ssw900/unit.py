"""A simulated WEG SSW900 with accessory SSW900-CRS485-W: its registers (rules S9-01 to S9-25).

Sections are those of ssw900. Which registers exist, and their limits, stand in the family's profile.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import ClassVar

from gateway.families import Parameter
from gateway.modbus import LineTiming
from gateway.sim.core.registers import Registers, is_writable
from gateway.sim.core.requests import refuse_address
from gateway.sim.core.setup import Quirks, Setup
from gateway.sim.ssw900.command_sources import SLOT_1_DECIDES
from gateway.sim.ssw900.faults import C8_TIMEOUT, C8_TIMEOUT_MODE, Faults
from gateway.sim.ssw900.readings import readings
from gateway.sim.weg.common import LOCAL_SOURCE, MODE, REMOTE_SOURCE

COMMAND_WORDS = {685: 1, 686: 2}  # S5.2.5, S5.2.6 -> slot
C7_BRAKING, C7_BRAKING_TIME = 500, 501  # C7.4.1, C7.4.2
C8_ADDRESS, C8_BAUD, C8_BYTES = 731, 732, 733
C9_CURRENT = 295  # C9.1.1
LONGEST_STRICT = 2  # requests of more registers pass over what does not exist or cannot be written (7.3)

_FRAMINGS = ("8N1", "8E1", "8O1", "8N2", "8E2", "8O2")  # C8.2.4


class Ssw900(Faults):
    """One SSW900, set up so that a start through Modbus works: C3.1 and C3.3 = the accessory's slot."""

    family: ClassVar[str] = "ssw900"
    delivered: ClassVar[Setup] = Setup(
        firmware="1.20", rated_current_a=105.0, response_s=(0.003, 0.015), restart_s=4.0
    )
    functions: ClassVar[frozenset[int]] = frozenset({1, 2, 3, 5, 6, 15, 16, 22, 43})  # table 7.1, but for 23

    def __init__(self, address: int, setup: Setup, quirks: Quirks) -> None:
        super().__init__(address, setup, quirks)
        self._coils = dict(setup.coils)
        rated_a, currents = setup.rated_current_a, self.registers.profile.enums["C9.1.1"]
        nominal = {400: 400, 401: round(rated_a * 10), 402: 1475, 404: 450, 405: 85, 406: 115}
        known = {float(label.removesuffix(" A")): number for number, label in currents.items()}
        sources = {MODE: SLOT_1_DECIDES[1] + 2 * (self.slot - 1), REMOTE_SOURCE: 3 + self.slot}
        self.settings.update({**nominal, C9_CURRENT: known.get(rated_a, 0), **sources, C8_ADDRESS: address})
        self.settings.update(setup.settings)
        self._take_up_braking()
        self._forget()

    def _line_settings(self, timing: LineTiming) -> dict[int, int]:
        """Return C8.2.3 and C8.2.4 (7)."""
        bauds = self.registers.profile.bauds
        if timing.baud not in bauds:
            return {}
        return {C8_BAUD: bauds.index(timing.baud), C8_BYTES: _FRAMINGS.index(str(timing.framing))}

    def _flags(self) -> dict[str, bool]:
        return {
            **super()._flags(),
            "s5_1_1_3": self.phase == "test",
            "s5_1_1_12": self.phase == "delay",
            "s5_1_1_13": self.is_after_stop,
            "alarm": bool(self.alarms),
        }

    # Requests

    def _read_registers(self, address: int, count: int) -> Sequence[int]:
        registers = range(address, address + count)
        check_read(self.registers, registers)
        there, measured = self.registers.owners, readings(self)
        return [self.registers.word(each, measured) if each in there else 0 for each in registers]

    def _read_coils(self, address: int, count: int) -> Sequence[bool]:
        return [_marker(self._coils, each) for each in range(address, address + count)]

    def _read_discrete_inputs(self, address: int, count: int) -> Sequence[bool]:
        return [_marker(self.setup.discrete_inputs, each) for each in range(address, address + count)]

    def _write_coils(self, address: int, bits: Sequence[bool]) -> None:
        self._read_coils(address, len(bits))  # refuses what is not there
        self._coils.update(enumerate(bits, address))

    def _write_registers(self, address: int, words: Sequence[int]) -> None:
        for row, its_words in writes(self.registers, address, words):
            self._set(row, its_words)

    def _set(self, row: Parameter, words: Sequence[int]) -> None:
        if row.is_stopped_only and self.motor.is_turning:
            return  # the answer is not stated: ours looks like success (erratum D-05)
        if row.address in COMMAND_WORDS:
            self.command_slot(COMMAND_WORDS[row.address], words[0])
            return
        self.registers.hold(row, words)
        if row.address == C8_ADDRESS:
            self.address = words[0]
        elif row.address in (C7_BRAKING, C7_BRAKING_TIME):
            self._take_up_braking()
        elif row.address in (C8_TIMEOUT, C8_TIMEOUT_MODE):
            self._watch()
        elif row.address in (MODE, LOCAL_SOURCE, REMOTE_SOURCE):
            self.sources_changed()

    def _take_up_braking(self) -> None:
        """Let stops brake for C7.4.2 where C7.4.1 has a method, whichever."""
        is_braked = self.settings[C7_BRAKING] != 0
        braking_s = float(self.settings[C7_BRAKING_TIME]) if is_braked else 0.0
        self.motor.data = replace(self.motor.data, braking_s=braking_s)

    def _identification(self) -> dict[int, str]:
        return {0: "WEG", 1: "SSW900", 2: f"V{self.setup.firmware}"}  # the texts are not stated: ours


def _marker(markers: Mapping[int, bool], address: int) -> bool:
    if address not in markers:
        raise refuse_address(address)
    return markers[address]


def check_read(table: Registers, registers: range) -> None:
    """Raise what answers a read of these registers, if it is refused (7.3)."""
    for register in registers if len(registers) <= LONGEST_STRICT else ():
        if register not in table.owners:
            raise refuse_address(register)
    _check_whole(table, registers)


def writes(table: Registers, address: int, words: Sequence[int]) -> list[tuple[Parameter, Sequence[int]]]:
    """Return what a write changes; raise what answers it, if it is refused (7.3, 7.4)."""
    registers = range(address, address + len(words))
    rows = {row.address: row for register in registers if (row := table.owners.get(register))}
    for register in registers if len(registers) <= LONGEST_STRICT else ():
        row = table.owners.get(register)
        if row is None or not is_writable(row):
            raise refuse_address(register)
    _check_whole(table, registers)
    changes = [
        (row, words[at - address : at - address + row.words]) for at, row in rows.items() if is_writable(row)
    ]
    for row, its_words in changes:
        table.check(row, its_words)
    return changes


def _check_whole(table: Registers, registers: range) -> None:
    """Refuse a part of a longer type, in requests of any length (7.3; erratum D-04)."""
    for register in (registers[0], registers[-1]):
        row = table.owners.get(register)
        if row is not None and not (row.address in registers and row.address + row.words - 1 in registers):
            raise refuse_address(register)
