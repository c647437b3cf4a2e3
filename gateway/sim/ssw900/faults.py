"""Faults, alarms and the communication timeout of a simulated SSW900 (ssw900 C8.2.5, S5.4, 9)."""

from __future__ import annotations

from typing import ClassVar

from gateway.sim.core.setup import Quirks, Setup
from gateway.sim.core.unit import Trip
from gateway.sim.ssw900.command_sources import CommandSources
from gateway.sim.weg.common import ENABLE, REMOTE, RUN

C8_TIMEOUT, C8_TIMEOUT_MODE, C8_TIMEOUT_ACTION = 734, 740, 741

FAULT_SILENCE = 128  # F128

_MODE_FAULT, _MODE_ALARM = 1, 2  # C8.2.5.1


class Faults(CommandSources):
    """The part of an SSW900 that trips."""

    fault_code: ClassVar[str] = "F{:03d}"

    def __init__(self, address: int, setup: Setup, quirks: Quirks) -> None:
        self.alarms: list[int] = []  # D2.1.1-D2.1.5
        self.received = self.transmitted = self.crc_errors = self.byte_errors = 0  # S5.4.2-S5.4.5
        super().__init__(address, setup, quirks)

    # For people and tests

    def set_alarm(self, number: int, *, is_on: bool) -> None:
        """Show alarm A`number`, or take it away."""
        self._catch_up()
        self.alarms = [each for each in self.alarms if each != number]
        if is_on:
            self.alarms.append(number)

    def note_reception_error(self, *, is_crc: bool, byte_count: int) -> None:
        """Count S5.4.4 or S5.4.5."""
        if is_crc:
            self.crc_errors += 1
        else:
            self.byte_errors += byte_count

    # The timeout C8.2.5

    def _checked_reply(self, reply: bytes) -> bytes | None:
        self.transmitted += 1
        return reply

    def _on_request(self) -> None:
        self.received += 1
        if FAULT_SILENCE in self.alarms:
            self.alarms.remove(FAULT_SILENCE)
        self.is_silence_shown = self.fault == FAULT_SILENCE
        self._watch()

    def _timeout_s(self) -> float:
        is_on = self.settings[C8_TIMEOUT_MODE] in (_MODE_FAULT, _MODE_ALARM)
        return self.settings[C8_TIMEOUT] / 10 if is_on else 0.0

    def _miss_telegrams(self) -> None:
        self.is_silence_shown = True
        if self.settings[C8_TIMEOUT_MODE] == _MODE_FAULT:
            self._fail(FAULT_SILENCE)
            return
        self.alarms.append(FAULT_SILENCE)
        self.trips.append(Trip(self.now_s, "A128"))
        action = self.settings[C8_TIMEOUT_ACTION]
        bits = self.command_words[self.slot]
        words = {1: bits & ~RUN, 2: bits & ~ENABLE, 3: bits & ~REMOTE, 4: bits | REMOTE}
        if action in words:
            self.command_slot(self.slot, words[action])

    def _clear_fault(self) -> None:
        self.is_silence_shown = False
        super()._clear_fault()

    def _forget(self) -> None:
        self.alarms = []
        self.phase = ""
        self.command_words = {1: ENABLE, 2: ENABLE}
        super()._forget()
