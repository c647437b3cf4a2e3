"""The command sources of a simulated SSW900: menu C3, the two slots' command words, and the way to a start.

Sections are those of ssw900; S9-xx are the rules this follows.
"""

from __future__ import annotations

from gateway.sim.core.power import MotorState
from gateway.sim.core.setup import Quirks, Setup
from gateway.sim.weg.common import ALL_COMMANDS, JOG, MODE, REMOTE, RESET, RUN, Commanded

C5_BEFORE_START, C5_AFTER_STOP = 931, 932  # C5.7.1, C5.7.2

SOURCE_SLOT_1 = 4  # a value of C3.2 and C3.3; slot 2 follows
SLOT_1_DECIDES = (9, 10)  # values of C3.1; slot 2's follow

INITIAL_TEST_S = 0.2  # not stated: ours


class CommandSources(Commanded):
    """The part of an SSW900 that carries out command words."""

    def __init__(self, address: int, setup: Setup, quirks: Quirks) -> None:
        self.slot = setup.slot  # where the RS-485 accessory sits
        self.command_words = {1: 0, 2: 0}  # S5.2.5, S5.2.6
        self.phase = ""  # between an accepted start and the ramp: "delay", then "test"
        super().__init__(address, setup, quirks)

    # Sources

    @property
    def active_slot(self) -> int | None:
        """The slot that commands the motor in the present mode, if one does."""
        source = self._source()
        return source - SOURCE_SLOT_1 + 1 if source >= SOURCE_SLOT_1 else None

    @property
    def command(self) -> int:
        """The command word that counts: the active slot's, else the accessory's own."""
        return self.command_words[self.active_slot or self.slot]

    @command.setter
    def command(self, bits: int) -> None:
        self.command_words[self.active_slot or self.slot] = bits

    @property
    def is_in_control(self) -> bool:
        """Whether a slot is the command source (C3)."""
        return self.active_slot is not None

    def active_source(self) -> int:
        """Return S3.1.2: source and mode in one number."""
        return 2 * self._source() + self.is_remote

    def command_slot(self, slot: int, value: int) -> None:
        """Take a word for S5.2.5 or S5.2.6; there is no mask (S5.2)."""
        bits = value & ALL_COMMANDS
        was_active = slot == self.active_slot
        if self._deciding_slot() == slot:
            self._set_remote(is_remote=bool(bits & REMOTE))
        if slot == self.active_slot:
            self._obey(bits, ALL_COMMANDS & ~REMOTE)
            self._store(slot, bits & REMOTE, REMOTE)
            return
        if bits & RUN:
            self.start_frames.append(self.now_s)
        is_rising = bits & RESET and not self.command_words[slot] & RESET
        self._store(slot, bits, ALL_COMMANDS)
        self._drop_inactive()
        if was_active:
            self._stop_as_commanded(bits, ALL_COMMANDS)
        if is_rising and self.is_fault:
            self._clear_fault()

    def sources_changed(self) -> None:
        """Take up a change of menu C3."""
        if self.settings[MODE] in (0, 1):
            self._set_remote(is_remote=self.settings[MODE] == 1)
        self._drop_inactive()

    def _set_remote(self, *, is_remote: bool) -> None:
        self.is_remote = is_remote
        slot = self._deciding_slot()
        if slot is not None:
            self._store(slot, REMOTE if is_remote else 0, REMOTE)
        self._drop_inactive()

    def _drop_inactive(self) -> None:
        """Clear run and jog of the slots that are not the active source (S5.2)."""
        for slot in self.command_words:
            if slot != self.active_slot:
                self._store(slot, 0, RUN | JOG)

    def _store(self, slot: int, bits: int, mask: int) -> None:
        self.command_words[slot] = self.command_words[slot] & ~mask | bits & mask

    def _deciding_slot(self) -> int | None:
        """Return the slot whose bit 4 chooses local or remote (C3.1)."""
        mode = self.settings[MODE] - SLOT_1_DECIDES[0]
        return mode // 2 + 1 if mode >= 0 else None

    def _may_switch_mode(self) -> bool:
        return False  # `command_slot` has done it

    # From a start to the ramp (C5.7, S5.1 bits 3, 12, 13)

    @property
    def is_started(self) -> bool:
        """Whether a start was accepted: the motor runs or is about to."""
        return self.motor.is_turned_on or bool(self.phase)

    @property
    def is_after_stop(self) -> bool:
        """Whether the time after a stop still runs; a start is then ignored (not stated: ours)."""
        return self.motor.standstill_s < self.settings[C5_AFTER_STOP] / 10

    def _is_start_delayed(self) -> bool:
        is_slowing = self.motor.is_turning and not self.motor.is_turned_on
        return is_slowing or self.is_after_stop

    def _start_motor(self) -> None:
        self.phase = "delay"
        self._at("start", self.now_s + self.settings[C5_BEFORE_START] / 10, self._begin_test)

    def _begin_test(self) -> None:
        self.phase = "test"
        self._at("start", self.now_s + INITIAL_TEST_S, self._begin_ramp)

    def _begin_ramp(self) -> None:
        self.phase = ""
        self.motor.start()

    def _stop_motor(self) -> None:
        self._abort_start()
        super()._stop_motor()

    def _stopped_otherwise(self) -> None:
        self._abort_start()
        super()._stopped_otherwise()

    def _abort_start(self) -> None:
        self.phase = ""
        self._cancel("start")

    def state_number(self) -> int:
        """Return S3.1.1."""
        if self.is_fault:
            return 2
        if not self.is_enabled:
            return 13
        if self.phase:
            return 11 if self.phase == "delay" else 1
        if self.is_reversing:
            return 9
        numbers = {
            MotorState.RAMP_UP: 3,
            MotorState.FULL_VOLTAGE: 4,
            MotorState.BYPASS: 5,
            MotorState.RAMP_DOWN: 7,
            MotorState.BRAKING: 8,
            MotorState.JOG: 10,
        }
        return numbers.get(self.motor.state, 12 if self.is_after_stop else 0)
