"""A simulated WEG SSW-06: command word with mask, adjusting modes, restarts (rules S6-01 to S6-24).

Sections are those of ssw06-es.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from gateway.sim.core.requests import refuse_value, word
from gateway.sim.weg.command_sources import OUTPUT_BY_SERIAL, P_ADDRESS, P_SERIAL, P_START_DELAY
from gateway.sim.weg.common import ALL_COMMANDS
from gateway.sim.weg.registers import VB00, VB01, VB03, VB06, VB07, VB08, VB09, VB10, BasicVariables

MODEL_NUMBER = 15  # VB00 (4.2.1)
FULL_SCALE = 16383  # VB09, VB10 (4.2.8)
DIVIDED_FROM_A = 820.0  # models from here on send currents and powers divided by ten (4.4)
AFTER_FACTORY_RESET, AFTER_P202 = 0x01, 0x02  # bits of VB06 and VB07 (4.2.4, 4.2.5)
FACTORY_RESET = 5  # P204 (4.3)

_FACTORY = {220: 2}  # what else chapter 2 prints is 0
_OUTPUTS = {VB09: (251, 252), VB10: (253, 254)}  # function and gain of the analog outputs (4.2.8)
_UNNAMED_DIVIDED = (47, 48, 53, 60, 63, 66, 69, 72, 75)  # of the list in 4.4


class Ssw06(BasicVariables):
    """One SSW-06; `answers_before_restart` None leaves it to chance (4.3: it may not answer)."""

    family: ClassVar[str] = "ssw06"
    product_name: ClassVar[str] = "SSW-06"
    per_register_s: ClassVar[float] = 0.010  # 5.3.1
    limits: ClassVar[Mapping[int, tuple[int, int]]] = {
        202: (0, 20),
        204: (0, 20),
        220: (0, 10),
        229: (0, 4),
        230: (0, 4),
        251: (0, 20),
        252: (0, 9999),
        253: (0, 20),
        254: (0, 9999),
        277: (0, 20),
        278: (0, 20),
        279: (0, 20),
        308: (1, 247),
        312: (1, 9),
        313: (0, 5),
        314: (0, 999),
    }
    delivered: ClassVar[Mapping[int, int]] = {252: 1000, 254: 1000}  # gain 1; ours
    outputs: ClassVar[Mapping[int, int]] = {0: 277, 1: 278, 2: 279}

    def __init__(
        self,
        address: int,
        *,
        answers_before_restart: bool | None = None,
        **options: Any,
    ) -> None:
        self.answers_before_restart = answers_before_restart
        self.is_alarm = False  # VB01 bit 6
        self.adjusting = 0  # VB06
        self.analog = {VB09: 0, VB10: 0}  # as far as the outputs follow them
        self._has_just_restarted = False
        super().__init__(address, **{"firmware": "1.60", "restart_s": 3.0, **options})

    @property
    def is_operable(self) -> bool:
        """Whether the motor can be run: not in an adjusting mode (4.3)."""
        return not self.adjusting

    @property
    def analog_pct(self) -> tuple[float, float]:
        """What AO1 and AO2 put out, gain applied."""
        first, second = (
            self.analog[variable] / FULL_SCALE * self.settings[gain] / 10
            for variable, (_, gain) in _OUTPUTS.items()
        )
        return first, second

    def status_word(self) -> int:
        """Return VB01 (4.2.2)."""
        return self._common_status() | self.is_alarm << 6

    def _write_command_word(self, value: int) -> None:
        """Obey the bits whose mask bit, eight places up, is set (4.2.3)."""
        self._obey(value & 0xFF, value >> 8 & ALL_COMMANDS)

    def _clear_fault(self) -> None:
        """Reset the error, which restarts the whole device (4.3)."""
        self._restart()
        self._has_just_restarted = True

    def _checked_reply(self, reply: bytes) -> bytes | None:
        """Return the reply, or nothing when the request has made the device restart."""
        has_restarted, self._has_just_restarted = self._has_just_restarted, False
        if not has_restarted:
            return reply
        answers = self.answers_before_restart
        if answers is None:
            answers = self.random.random() < 0.5
        return reply if answers else None

    def _writable_variables(self) -> tuple[int, ...]:
        return VB03, VB07, VB08, VB09, VB10

    def _check_write(self, number: int, value: int) -> None:
        super()._check_write(number, value)
        if number in _OUTPUTS and value > FULL_SCALE:
            raise refuse_value(f"{value} is more than 16383")
        if number == VB07 and value & ~self.adjusting and self.is_command_refused:
            raise refuse_value("not in that adjusting mode")

    def _write(self, number: int, value: int) -> None:
        if number == VB07:
            self._leave_adjusting(value)
        elif number in _OUTPUTS:
            if self.settings[_OUTPUTS[number][0]] == OUTPUT_BY_SERIAL:
                self.analog[number] = value
        else:
            is_changed = number == 202 and value != self.settings[202]
            super()._write(number, value)
            if is_changed:
                self._adjust(AFTER_P202)
            elif (number, value) == (204, FACTORY_RESET):
                self._load_factory()

    def _adjust(self, mode: int) -> None:
        self.adjusting |= mode
        self._disable()

    def _load_factory(self) -> None:
        """Take up the factory settings, but stay on the line."""
        preserved = {number: self.settings[number] for number in (P_ADDRESS, P_SERIAL, P_START_DELAY)}
        self.settings = {**dict.fromkeys(self.limits, 0), **self.delivered, **_FACTORY, **preserved}
        self._watch()
        self._adjust(AFTER_FACTORY_RESET)

    def _leave_adjusting(self, value: int) -> None:
        """Leave a mode that VB06 shows, by a restart (4.2.5, 4.3)."""
        if value & self.adjusting:
            self.adjusting &= ~value
            self._restart()
            self._has_just_restarted = True

    def _clear_outputs(self) -> None:
        super()._clear_outputs()
        self.analog = {VB09: 0, VB10: 0}

    def _readings(self) -> Mapping[int, int]:
        meter = self.meter
        decimals = 0 if self.rated_current_a >= DIVIDED_FROM_A else 1
        to_rated = self.motor.data.rated_current_a / self.rated_current_a
        return {
            0: 0,
            1: word(meter.current_pct * to_rated, 1),
            2: word(meter.current_pct, 1),
            3: word(meter.current_a, decimals),
            6: self._state_number(),
            10: word(meter.active_kw, decimals),
            11: word(meter.apparent_kva, decimals),
            **{30 + place: word(each_a, decimals) for place, each_a in enumerate(meter.phase_currents_a)},
            **dict.fromkeys(_UNNAMED_DIVIDED, 0),
            100: 0,
            295: word(self.rated_current_a),
            951: 0,
            VB00: MODEL_NUMBER,
            VB01: self.status_word(),
            VB03: self.shown_command,
            VB06: self.adjusting,
            VB07: 0,
            VB08: self.relays,
            **self.analog,
        }
