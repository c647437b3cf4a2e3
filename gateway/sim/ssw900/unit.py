"""A simulated WEG SSW900 with accessory SSW900-CRS485-W: its registers (rules S9-01 to S9-25).

Sections are those of ssw900. Which registers exist, and their limits, stand in the family's profile.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import ClassVar

from gateway.families import load_profile
from gateway.modbus.timing import LineTiming
from gateway.sim.core.power import MotorData, MotorState
from gateway.sim.core.requests import refuse_address
from gateway.sim.ssw900.command_sources import (
    C3_LOCAL_SOURCE,
    C3_MODE,
    C3_REMOTE_SOURCE,
    REMOTE_AT_POWER_UP,
    SLOT_1_DECIDES,
    SOURCE_SLOT_1,
)
from gateway.sim.ssw900.faults import C8_TIMEOUT, C8_TIMEOUT_MODE, Faults
from gateway.sim.ssw900.readings import readings
from gateway.sim.ssw900.registers import NetId, NetIds
from gateway.sim.weg.common import ENABLE

COMMAND_WORDS = {685: 1, 686: 2}  # S5.2.5, S5.2.6 -> slot
C7_BRAKING, C7_BRAKING_TIME = 500, 501  # C7.4.1, C7.4.2
C8_ADDRESS, C8_BAUD, C8_BYTES = 731, 732, 733

_BAUDS = (9600, 19200, 38400, 57600)  # C8.2.3
_FRAMINGS = ("8N1", "8E1", "8O1", "8N2", "8E2", "8O2")  # C8.2.4

# Factory settings as far as the manual prints them, else the lowest value.
_DEFAULTS = {730: 2, 732: 1, 733: 1, 741: 3, 712: 1, 713: 1, 753: 26, 754: 1, 714: 1, 715: 1, 755: 11, 756: 1}


class Ssw900(Faults):
    """One SSW900, set up so that a start through Modbus works: C3.1 and C3.3 = the accessory's slot."""

    family: ClassVar[str] = "ssw900"
    functions: ClassVar[frozenset[int]] = frozenset({1, 2, 3, 5, 6, 15, 16, 22, 43})  # table 7.1, but for 23

    def __init__(
        self,
        address: int,
        *,
        seed: int = 0,
        slot: int = 1,
        rated_current_a: float = 105.0,
        firmware: str = "1.20",
        serial_number: int = 0,
        motor: MotorData | None = None,
        response_s: tuple[float, float] = (0.003, 0.015),
        restart_s: float = 4.0,
        settings: Mapping[int, int] | None = None,
        coils: Mapping[int, bool] | None = None,  # bit markers of a SoftPLC program, by address (7.2.2)
        discrete_inputs: Mapping[int, bool] | None = None,
        keeps_run_command: bool = False,
        is_running_while_stopping: bool = False,
    ) -> None:
        self.rated_current_a = rated_current_a
        self.firmware = firmware
        self.serial_number = serial_number or 1_000_000 + seed
        self.is_running_while_stopping = is_running_while_stopping
        self._coils = dict(coils or {})
        self._discrete_inputs = dict(discrete_inputs or {})
        self.fixed: dict[int, int] = {}  # registers that a test nails down
        self._map = NetIds(load_profile("ssw900").parameters.values())
        sources = {C3_MODE: SLOT_1_DECIDES[1] + 2 * (slot - 1), C3_REMOTE_SOURCE: SOURCE_SLOT_1 + slot - 1}
        self._words = {**self._factory(), **sources, C8_ADDRESS: address, **(settings or {})}
        super().__init__(
            address,
            slot=slot,
            seed=seed,
            motor=motor or MotorData(rated_current_a=rated_current_a),
            response_s=response_s,
            restart_s=restart_s,
            keeps_run_command=keeps_run_command,
        )
        self._take_up_braking()
        self._forget()

    def setting(self, net_id: int) -> int:
        """Return a parameter of one register."""
        return self._words.get(net_id, 0)

    def listens_to(self, timing: LineTiming) -> bool:
        """Return whether C8.2.3 and C8.2.4 fit (7)."""
        if timing.baud not in _BAUDS:
            return timing == self._joined
        return (timing.baud, str(timing.framing)) == (
            _BAUDS[self.setting(C8_BAUD)],
            _FRAMINGS[self.setting(C8_BYTES)],
        )

    def join(self, timing: LineTiming) -> None:
        """Set C8.2.3 and C8.2.4 to the line's speed and framing."""
        super().join(timing)
        if timing.baud in _BAUDS:
            self._words[C8_BAUD] = _BAUDS.index(timing.baud)
            self._words[C8_BYTES] = _FRAMINGS.index(str(timing.framing))

    def status_word(self) -> int:
        """Return S5.1.1."""
        motor = self.motor
        flags = {
            0: self.is_running,
            1: self.is_enabled,
            2: motor.state is MotorState.JOG,
            3: self.phase == "test",
            4: motor.state is MotorState.RAMP_UP,
            5: motor.is_at_full_voltage,
            6: motor.state is MotorState.BYPASS,
            7: motor.state is MotorState.RAMP_DOWN,
            8: self.is_remote,
            9: motor.state is MotorState.BRAKING,
            10: self.is_reversing,
            11: self.is_reverse,
            12: self.phase == "delay",
            13: self.is_after_stop,
            14: bool(self.alarms),
            15: self.is_fault,
        }
        return sum(1 << bit for bit, is_set in flags.items() if is_set)

    # Requests

    def _read_registers(self, address: int, count: int) -> Sequence[int]:
        registers = range(address, address + count)
        self._map.check_read(registers)
        measured = readings(self)
        return [self._register(register, measured) for register in registers]

    def _read_coils(self, address: int, count: int) -> Sequence[bool]:
        return [_marker(self._coils, each) for each in range(address, address + count)]

    def _read_discrete_inputs(self, address: int, count: int) -> Sequence[bool]:
        return [_marker(self._discrete_inputs, each) for each in range(address, address + count)]

    def _write_coils(self, address: int, bits: Sequence[bool]) -> None:
        self._read_coils(address, len(bits))  # refuses what is not there
        self._coils.update(enumerate(bits, address))

    def _register(self, register: int, measured: Mapping[int, int]) -> int:
        if register in self.fixed:
            return self.fixed[register]
        if register in COMMAND_WORDS:
            return 0 if self.hides_command_bits else self.command_words[COMMAND_WORDS[register]]
        owner = self._map.owners.get(register)
        if owner is None:
            return 0
        if owner.start in measured:
            return owner.split(measured[owner.start])[register - owner.start]
        return self._words.get(register, 0)

    def _write_registers(self, address: int, words: Sequence[int]) -> None:
        for owner, its_words in self._map.writes(address, words):
            self._set(owner, its_words)

    def _set(self, owner: NetId, words: Sequence[int]) -> None:
        if owner.is_stopped_only and self.motor.is_turning:
            return  # the answer is not stated: ours looks like success (erratum D-05)
        if owner.start in COMMAND_WORDS:
            self.command_slot(COMMAND_WORDS[owner.start], words[0])
            return
        self._words.update(zip(owner.registers, words, strict=True))
        if owner.start == C8_ADDRESS:
            self.address = words[0]
        elif owner.start in (C7_BRAKING, C7_BRAKING_TIME):
            self._take_up_braking()
        elif owner.start in (C8_TIMEOUT, C8_TIMEOUT_MODE):
            self._watch()
        elif owner.start in (C3_MODE, C3_LOCAL_SOURCE, C3_REMOTE_SOURCE):
            self.sources_changed()

    def _take_up_braking(self) -> None:
        """Let stops brake for C7.4.2 where C7.4.1 has a method, whichever."""
        is_braked = self.setting(C7_BRAKING) != 0
        braking_s = float(self.setting(C7_BRAKING_TIME)) if is_braked else 0.0
        self.motor.data = replace(self.motor.data, braking_s=braking_s)

    def _identification(self) -> dict[int, str]:
        return {0: "WEG", 1: "SSW900", 2: f"V{self.firmware}"}  # the texts are not stated: ours

    def _forget(self) -> None:
        super()._forget()
        self.phase = ""
        self.command_words = {1: ENABLE, 2: ENABLE}
        self.is_disabled = False
        self._set_remote(is_remote=self.setting(C3_MODE) in REMOTE_AT_POWER_UP)

    def _factory(self) -> dict[int, int]:
        """Return the settings that are not 0."""
        rated = {400: 400, 401: round(self.rated_current_a * 10), 402: 1475, 404: 450, 405: 85, 406: 115}
        words: dict[int, int] = {}
        for owner in {each.start: each for each in self._map.owners.values()}.values():
            if owner.is_writable and (owner.lowest or 0) > 0:
                words.update(zip(owner.registers, owner.split(owner.lowest or 0), strict=True))
        return {**words, **_DEFAULTS, **rated}


def _marker(markers: Mapping[int, bool], address: int) -> bool:
    if address not in markers:
        raise refuse_address(address)
    return markers[address]
