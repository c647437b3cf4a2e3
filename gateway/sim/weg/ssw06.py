"""A simulated WEG SSW-06: command word with mask, adjusting modes, restarts (rules S6-01 to S6-24).

Sections are those of ssw06-es.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from gateway.sim.core.requests import refuse_value
from gateway.sim.core.setup import Quirks, Setup
from gateway.sim.weg.command_sources import OUTPUT_BY_SERIAL, P_ADDRESS, P_SERIAL, P_START_DELAY
from gateway.sim.weg.common import ALL_COMMANDS
from gateway.sim.weg.registers import BasicVariables

VB07, VB09, VB10 = 5007, 5009, 5010
MODEL_NUMBER = 15  # VB00 (4.2.1)
FULL_SCALE = 16383  # VB09, VB10 (4.2.8)
DIVIDED_FROM_A = 820.0  # models from here on send currents and powers divided by ten (4.4)
AFTER_FACTORY_RESET, AFTER_P202 = 0x01, 0x02  # bits of VB06 and VB07 (4.2.4, 4.2.5)
FACTORY_RESET = 5  # P204 (4.3)

_OUTPUTS = {VB09: (251, 252), VB10: (253, 254)}  # function and gain of the analog outputs (4.2.8)
_GAINS = {252: 1000, 254: 1000}  # as delivered: 1; ours


class Ssw06(BasicVariables):
    """One SSW-06."""

    family: ClassVar[str] = "ssw06"
    delivered: ClassVar[Setup] = Setup(
        product="SSW-06", firmware="1.60", response_s=(0.005, 0.010), restart_s=3.0
    )

    def __init__(self, address: int, setup: Setup, quirks: Quirks) -> None:
        self.is_alarm = False  # VB01 bit 6
        self.adjusting = 0  # VB06
        self.analog = {VB09: 0, VB10: 0}  # as far as the outputs follow them
        self._has_just_restarted = False
        super().__init__(address, setup, quirks)
        self.settings.update({**_GAINS, **setup.settings})

    @property
    def is_operable(self) -> bool:
        """Whether the motor can be run: not in an adjusting mode (4.3)."""
        return not self.adjusting

    @property
    def analog_pct(self) -> tuple[float, float]:
        """The output of AO1 and AO2, gain applied."""
        first, second = (
            self.analog[variable] / FULL_SCALE * self.settings[gain] / 10
            for variable, (_, gain) in _OUTPUTS.items()
        )
        return first, second

    def _flags(self) -> dict[str, bool]:
        return {**super()._flags(), "alarm": self.is_alarm}

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
        answers = self.quirks.answers_before_restart
        if answers is None:
            answers = self.random.random() < 0.5
        return reply if answers else None

    def _check_write(self, number: int, value: int) -> None:
        super()._check_write(number, value)
        if number == VB07 and value & ~self.adjusting and self.quirks.is_command_refused:
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
        self.registers.deliver()
        self.settings.update({**_GAINS, **preserved})
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

    def _readings(self) -> Mapping[str, float]:
        analog = dict(zip(("VB09", "VB10"), self.analog.values(), strict=True))
        found: dict[str, float] = {
            "P010": self.meter.active_kw,
            "VB00": MODEL_NUMBER,
            "VB06": self.adjusting,
            **analog,
        }
        if self.setup.rated_current_a < DIVIDED_FROM_A:
            return found
        rows = self.registers.profile.parameters
        whole = {**self._electric(), **found}
        return {code: value / 10 if rows[code].is_rated_scaled else value for code, value in whole.items()}
