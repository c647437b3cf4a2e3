"""A simulated WEG SSW-07 or SSW-08: command word without mask (rules S7-01 to S7-14)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from gateway.sim.core.requests import word
from gateway.sim.weg.common import ALL_COMMANDS, JOG, REVERSE
from gateway.sim.weg.registers import VB01, VB03, VB08, BasicVariables

_MANY_FUNCTIONS_SINCE = (1, 40)  # jog, direction, their status bits: from V1.4x (4.2.1, 4.2.2)


class Ssw07(BasicVariables):
    """One SSW-07; an SSW-08 with product = "SSW-08"."""

    family: ClassVar[str] = "ssw07"
    product_name: ClassVar[str] = "SSW-07"
    conformity: ClassVar[int] = 0x51  # as the example of 5.4.7 has it; no value of the specification
    per_register_s: ClassVar[float] = 0.020  # 5.3.1
    limits: ClassVar[Mapping[int, tuple[int, int]]] = {
        220: (0, 8),
        229: (0, 3),
        230: (0, 3),
        277: (0, 20),
        278: (0, 20),
        308: (1, 247),
        312: (1, 9),
        313: (0, 3),
        314: (0, 999),
    }
    delivered: ClassVar[Mapping[int, int]] = {313: 1}  # 2.3
    outputs: ClassVar[Mapping[int, int]] = {0: 277, 1: 278}

    def __init__(
        self, address: int, *, firmware: str = "1.40", restart_s: float = 2.0, **options: Any
    ) -> None:
        super().__init__(address, firmware=firmware, restart_s=restart_s, **options)

    @property
    def has_many_functions(self) -> bool:
        """Whether the software knows jog and direction."""
        major, _, minor = self.firmware.partition(".")
        return (int(major), int(minor)) >= _MANY_FUNCTIONS_SINCE

    def status_word(self) -> int:
        """Return VB01 (4.2.1)."""
        bits = self._common_status()
        if not self.has_many_functions:
            bits &= ~(1 << 2 | 1 << 9 | 1 << 10 | 1 << 11)
        return bits

    def _write_command_word(self, value: int) -> None:
        """Take all commands at once: there is no mask (4.2.2)."""
        self._obey(value, self._known(ALL_COMMANDS))

    def _obey(self, values: int, mask: int) -> None:
        super()._obey(values, self._known(mask))

    def _known(self, mask: int) -> int:
        return mask if self.has_many_functions else mask & ~(JOG | REVERSE)

    def _readings(self) -> Mapping[int, int]:
        meter, motor = self.meter, self.motor
        to_rated = motor.data.rated_current_a / self.rated_current_a
        return {
            0: 0,
            1: word(meter.current_pct * to_rated, 1),
            2: word(meter.current_pct, 1),
            3: word(meter.current_a, 1),
            5: word(meter.line_frequency_hz, 1),
            6: self._state_number(),
            7: word(motor.output_pct),
            11: word(meter.apparent_kva, 1),
            12: int(self.is_enable_input_on),
            13: self.relays,
            **dict(enumerate(self.fault_history, 14)),
            23: int(self.firmware.replace(".", "")),
            **{30 + place: word(current_a, 1) for place, current_a in enumerate(meter.phase_currents_a)},
            50: word(motor.thermal_pct * 2.5),  # trips at 250 %
            81: word(max(motor.heatsink_c, 10.0), 1),
            **dict.fromkeys(range(90, 97), 0),  # no CAN or DeviceNet
            101: 30,
            265: 0,
            295: word(self.rated_current_a),
            VB01: self.status_word(),
            VB03: self.shown_command,
            VB08: self.relays,
        }
