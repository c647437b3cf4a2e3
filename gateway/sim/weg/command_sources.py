"""Where an SSW-06 or SSW-07 takes its commands from, what its faults do, and E28: parameters P220 to P314.

Sections are those of ssw06-es and ssw07-ssw08, which are alike here.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import ClassVar

from gateway.sim.core.power import MotorData, MotorTrip
from gateway.sim.core.unit import Trip
from gateway.sim.weg.common import ENABLE, FAULT_NUMBERS, RUN, Commanded

P_LOCAL_REMOTE, P_LOCAL_SOURCE, P_REMOTE_SOURCE = 220, 229, 230
P_ADDRESS, P_SERIAL, P_ACTION, P_TIMEOUT, P_START_DELAY = 308, 312, 313, 314, 630

SOURCE_KEYPAD, SOURCE_SERIAL = 0, 2  # values of P229 and P230 (2.6, 2.7)
MODE_BY_SERIAL = (5, 6)  # values of P220 (2.5)
REMOTE_AT_POWER_UP = (1, 3, 6, 8, 10)  # values of P220
OUTPUT_BY_SERIAL = 7  # "Serial" in P251, P253, P277-P279; its number is not printed: ours

ACTION_NONE, ACTION_STOP, ACTION_DISABLE, ACTION_TO_LOCAL, ACTION_FATAL = 0, 1, 2, 3, 5  # P313 (2.3)

FAULT_OVERLOAD, FAULT_SILENCE = FAULT_NUMBERS[MotorTrip.OVERLOAD], 28  # 28 is the serial manuals'
COMMUNICATION_FAULTS = (28, 29, 30)  # cannot be reset through the network (4.2.2, 4.2.3)


class Supervised(Commanded):
    """A starter with those parameters, set up so that a start through Modbus works: P220 = 6, P230 = 2."""

    limits: ClassVar[Mapping[int, tuple[int, int]]]  # of the parameters that can be written
    delivered: ClassVar[Mapping[int, int]] = {}  # settings as delivered that are not 0
    shortest_s: ClassVar[float] = 0.005  # 5.3.1
    per_register_s: ClassVar[float]

    def __init__(
        self,
        address: int,
        *,
        seed: int = 0,
        rated_current_a: float = 85.0,
        firmware: str,
        motor: MotorData | None = None,
        restart_s: float,
        settings: Mapping[int, int] | None = None,
        is_command_refused: bool = False,
        keeps_run_command: bool = False,
        is_running_while_stopping: bool = False,
        is_e28_resettable: bool = False,
    ) -> None:
        self.rated_current_a = rated_current_a  # of the starter; the motor's may be smaller
        self.firmware = firmware
        self.is_command_refused = is_command_refused  # erratum A-06: exception 3 instead of nothing
        self.is_running_while_stopping = is_running_while_stopping  # not stated for the SSW-07
        self.is_e28_resettable = is_e28_resettable  # erratum C-13, P313 = 5
        self.settings = {**self._set_up(address), **(settings or {})}
        self.fault = 0  # the number behind E
        self.fault_history = [0, 0, 0, 0]
        self.is_silence_shown = False  # E28
        super().__init__(
            address,
            seed=seed,
            motor=motor or MotorData(rated_current_a=rated_current_a),
            response_s=(self.shortest_s, self.per_register_s),
            restart_s=restart_s,
            keeps_run_command=keeps_run_command,
        )
        self._forget()

    # For people and tests

    def reset_at_keypad(self) -> None:
        """Reset any fault at the starter itself."""
        self._catch_up()
        if self.fault:
            self._clear_fault()

    # What Commanded asks

    @property
    def is_in_control(self) -> bool:
        """Whether run, enable, jog and direction come from serial in the present mode (2.6, 2.7)."""
        return self._source() == SOURCE_SERIAL

    @property
    def is_keypad_in_control(self) -> bool:
        """Whether they come from the keypad."""
        return self._source() == SOURCE_KEYPAD

    def _may_switch_mode(self) -> bool:
        return self.settings[P_LOCAL_REMOTE] in MODE_BY_SERIAL

    def _is_resettable(self) -> bool:
        is_silence_over = self.fault == FAULT_SILENCE and self.is_e28_resettable
        return self.fault not in COMMUNICATION_FAULTS or is_silence_over

    def _is_start_delayed(self) -> bool:
        """Return whether P630 runs: a start is then ignored without a word (4.3)."""
        delay_s = self.settings[P_START_DELAY]
        is_slowing = self.motor.is_turning and not self.motor.is_turned_on
        return delay_s > 0 and (is_slowing or self.motor.standstill_s < delay_s)

    def _clear_fault(self) -> None:
        self.fault = 0
        self._run_if_commanded()

    # E28

    def _on_request(self) -> None:
        if self.is_silence_shown and self.fault != FAULT_SILENCE:
            self.is_silence_shown = False  # it goes when communication returns (2.4)
            self.is_disabled = False
        self._watch()

    def _switched_on(self) -> None:
        self._watch()

    def _watch(self) -> None:
        timeout_s = self.settings[P_TIMEOUT]
        if timeout_s:
            self._at("P314", self.now_s + timeout_s, self._miss_telegrams)
        else:
            self._cancel("P314")

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
        elif action == ACTION_TO_LOCAL and self.settings[P_LOCAL_REMOTE] in MODE_BY_SERIAL:
            self._set_remote(is_remote=False)
        elif action == ACTION_FATAL:
            self.fault = FAULT_SILENCE
            self.motor.cut()
            self._stopped_otherwise()

    @abstractmethod
    def _clear_outputs(self) -> None:
        """Set to zero what the network drives."""

    def _motor_tripped(self, cause: MotorTrip) -> None:
        self._fail(FAULT_NUMBERS[cause])

    def _fail(self, number: int) -> None:
        self.fault = number
        self.fault_history = [number, *self.fault_history[:3]]
        self.trips.append(Trip(self.now_s, f"E{number:02d}"))
        self.motor.cut()
        self._stopped_otherwise()

    def _forget(self) -> None:
        self.fault = 0
        self.is_silence_shown = False
        self._clear_outputs()
        self.command = ENABLE
        self.is_disabled = False
        self._set_remote(is_remote=self.settings[P_LOCAL_REMOTE] in REMOTE_AT_POWER_UP)

    def _set_up(self, address: int) -> dict[int, int]:
        """Return the settings of a starter that shall obey the serial line."""
        return {
            **dict.fromkeys(self.limits, 0),
            **self.delivered,
            P_LOCAL_REMOTE: 6,
            P_REMOTE_SOURCE: SOURCE_SERIAL,
            P_ADDRESS: address,
            P_SERIAL: 1,
            P_START_DELAY: 0,
        }

    def _source(self) -> int:
        return self.settings[P_REMOTE_SOURCE if self.is_remote else P_LOCAL_SOURCE]
