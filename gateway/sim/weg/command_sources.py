"""Where an SSW-06 or SSW-07 takes its commands from, what its faults do, and E28: parameters P220 to P314.

Sections are those of ssw06-es and ssw07-ssw08, which are alike here.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar

from gateway.sim.core.power import MotorTrip
from gateway.sim.core.setup import Quirks, Setup
from gateway.sim.core.unit import Trip
from gateway.sim.weg.common import (
    ENABLE,
    FAULT_NUMBERS,
    KEYPAD,
    LOCAL_SOURCE,
    MODE,
    REMOTE_SOURCE,
    RUN,
    Commanded,
)

P_ADDRESS, P_SERIAL, P_ACTION, P_TIMEOUT, P_START_DELAY = 308, 312, 313, 314, 630

SOURCE_SERIAL = 2  # a value of P229 and P230 (2.6, 2.7)
MODE_BY_SERIAL = (5, 6)  # values of P220 (2.5)
OUTPUT_BY_SERIAL = 7  # "Serial" in P251, P253, P277-P279; its number is not printed: ours

ACTION_NONE, ACTION_STOP, ACTION_DISABLE, ACTION_TO_LOCAL, ACTION_FATAL = 0, 1, 2, 3, 5  # P313 (2.3)

FAULT_OVERLOAD, FAULT_SILENCE = FAULT_NUMBERS[MotorTrip.OVERLOAD], 28  # 28 is the serial manuals'
COMMUNICATION_FAULTS = (28, 29, 30)  # cannot be reset through the network (4.2.2, 4.2.3)


class Supervised(Commanded):
    """A starter with those parameters, set up so that a start through Modbus works: P220 = 6, P230 = 2."""

    fault_code: ClassVar[str] = "E{:02d}"

    def __init__(self, address: int, setup: Setup, quirks: Quirks) -> None:
        super().__init__(address, setup, quirks)
        self.fault_history = [0, 0, 0, 0]
        self.settings.update({MODE: MODE_BY_SERIAL[1], LOCAL_SOURCE: KEYPAD, REMOTE_SOURCE: SOURCE_SERIAL})
        self.settings.update({P_ADDRESS: address, **setup.settings})
        self._forget()

    # Asked by Commanded

    @property
    def is_in_control(self) -> bool:
        """Whether run, enable, jog and direction come from serial in the present mode (2.6, 2.7)."""
        return self._source() == SOURCE_SERIAL

    def _may_switch_mode(self) -> bool:
        return self.settings[MODE] in MODE_BY_SERIAL

    def _is_resettable(self) -> bool:
        is_silence_over = self.fault == FAULT_SILENCE and self.quirks.is_e28_resettable
        return self.fault not in COMMUNICATION_FAULTS or is_silence_over

    def _is_start_delayed(self) -> bool:
        """Return whether P630 runs: a start is then ignored without a word (4.3)."""
        delay_s = self.settings[P_START_DELAY]
        is_slowing = self.motor.is_turning and not self.motor.is_turned_on
        return delay_s > 0 and (is_slowing or self.motor.standstill_s < delay_s)

    def _fail(self, number: int) -> None:
        self.fault_history = [number, *self.fault_history[:3]]
        super()._fail(number)

    # E28

    def _on_request(self) -> None:
        if self.is_silence_shown and self.fault != FAULT_SILENCE:
            self.is_silence_shown = False  # it goes when communication returns (2.4)
            self.is_disabled = False
        self._watch()

    def _switched_on(self) -> None:
        self._watch()

    def _timeout_s(self) -> float:
        return self.settings[P_TIMEOUT]

    def _miss_telegrams(self) -> None:
        """Show E28 and do what P313 says (2.3, 2.4)."""
        self.trips.append(Trip(self.now_s, "E28"))
        self.is_silence_shown = True
        self._clear_outputs()
        action = self.settings[P_ACTION]
        if action == ACTION_STOP and self.is_in_control:
            self.command &= ~RUN
            self.motor.stop()
        elif action == ACTION_DISABLE:
            self.command &= ~(RUN | ENABLE)
            self.is_disabled = not self.is_in_control  # until communication returns
            self.motor.cut()
        elif action == ACTION_TO_LOCAL and self.settings[MODE] in MODE_BY_SERIAL:
            self._set_remote(is_remote=False)
        elif action == ACTION_FATAL:
            self.fault = FAULT_SILENCE
            self.motor.cut()
            self._stopped_otherwise()

    @abstractmethod
    def _clear_outputs(self) -> None:
        """Set to zero what the network drives."""

    def _forget(self) -> None:
        self._clear_outputs()
        self.command = ENABLE
        super()._forget()
