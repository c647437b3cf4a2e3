"""A simulated WEG SSW-07 or SSW-08: command word without mask (rules S7-01 to S7-14)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from gateway.sim.core.setup import Setup
from gateway.sim.weg.common import ALL_COMMANDS, JOG, REVERSE
from gateway.sim.weg.registers import BasicVariables

_MANY_FUNCTIONS_SINCE = (1, 40)  # jog, direction, their status bits: from V1.4x (4.2.1, 4.2.2)


class Ssw07(BasicVariables):
    """One SSW-07; an SSW-08 with product = "SSW-08"."""

    family: ClassVar[str] = "ssw07"
    delivered: ClassVar[Setup] = Setup(
        product="SSW-07", firmware="1.40", response_s=(0.005, 0.020), restart_s=2.0
    )
    conformity: ClassVar[int] = 0x51  # as the example of 5.4.7 has it; no value of the specification

    @property
    def has_many_functions(self) -> bool:
        """Whether the software knows jog and direction."""
        major, _, minor = self.setup.firmware.partition(".")
        return (int(major), int(minor)) >= _MANY_FUNCTIONS_SINCE

    def _write_command_word(self, value: int) -> None:
        """Take all commands at once: there is no mask (4.2.2)."""
        self._obey(value, ALL_COMMANDS)

    def _obey(self, values: int, mask: int) -> None:
        super()._obey(values, mask if self.has_many_functions else mask & ~(JOG | REVERSE))

    def _readings(self) -> Mapping[str, float]:
        meter, motor = self.meter, self.motor
        return {
            "P001": meter.current_pct * motor.data.rated_current_a / self.setup.rated_current_a,
            "P005": meter.line_frequency_hz,
            "P007": motor.output_pct,
            "P012": int(self.is_enable_input_on),
            "P013": self.relays,
            **dict(zip(("P014", "P015", "P016", "P017"), self.fault_history, strict=True)),
            "P023": float(self.setup.firmware),
            "P050": motor.thermal_pct * 2.5,  # trips at 250 %
            "P081": max(motor.heatsink_c, 10.0),
            "P101": 30,
        }
