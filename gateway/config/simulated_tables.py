"""The tables of a simulated starter: what `simulate` and `demo` make of it; the gateway ignores them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from typing import Annotated, Literal

from pydantic import Field

from gateway.config.mistakes import Mistake
from gateway.config.values import ConfigTable, Firmware
from gateway.contract import CommandError
from gateway.families import Profile, parameters

Delay = Annotated[float, Field(ge=0.1, le=999)]  # s
TimeConstant = Annotated[float, Field(ge=1, le=86400)]  # s
Share = Annotated[float, Field(ge=0, le=100)]  # %
Excess = Annotated[float, Field(ge=0, le=1000)]  # %


class SimulatedMotorTable(ConfigTable):
    """`[line.starter.simulated.motor]`: the motor behind a simulated starter; keys may be left out."""

    load_pct: Excess | None = Field(None, description="Share of the rated load.")
    start_current_pct: float | None = Field(None, ge=100, le=1000, description="Of the rated current.")
    ramp_up_s: Delay | None = Field(None, description="Ramp of a start, until the starter is configured.")
    ramp_down_s: float | None = Field(None, ge=0, le=999, description="Ramp of a stop.")
    friction_pct: Excess | None = Field(None, description="By how much longer the motor accelerates.")
    wear_per_start_pct: Share | None = Field(None, description="Growth of friction_pct by each start.")
    wear_per_hour_pct: Share | None = Field(
        None, description="Growth of friction_pct by each hour of running."
    )
    thermal_pct: float | None = Field(None, ge=0, lt=100, description="Thermal image at first, of the trip.")
    heating_s: TimeConstant | None = Field(None, description="Of the thermal image while current flows.")
    cooling_s: TimeConstant | None = Field(None, description="Of the thermal image at standstill.")
    undervoltage_pct: Share | None = Field(None, description="Below this share of its voltage it trips.")
    undervoltage_s: Delay | None = Field(None, description="After so long an undervoltage it trips.")
    phase_loss_s: Delay | None = Field(None, description="After so long without one phase it trips.")
    line_voltage_pct: float = Field(100.0, ge=0, le=120, description="Of the supply, of the rated one.")
    lost_phase: Literal["r", "s", "t"] | None = Field(None, description="The phase that is missing.")


class SimulatedTable(ConfigTable):
    """`[line.starter.simulated]`: what `simulate` makes of a starter; the gateway itself ignores it."""

    firmware: Firmware | None = Field(None, description='The firmware that it says it has, e.g. "1.30".')
    parameters: dict[str, Annotated[int, Field(ge=0, le=0xFFFF)]] = Field(
        {}, description="Words of its parameters by the manual's code, as on the wire."
    )
    markers: dict[str, bool] = Field(
        {}, description="SSW900: bits of a SoftPLC program, by COIL or DI, address."
    )
    braking_s: float = Field(0.0, ge=0, le=600, description="SSW-06, SSW-07: DC braking at a stop; 0: none.")
    motor: SimulatedMotorTable = Field(SimulatedMotorTable(), description="The motor behind it.")

    def not_of(self, profile: Profile) -> Iterator[Mistake]:
        """Yield what a starter of this family cannot be given, by keys that begin below this table."""
        for option in ("markers", "braking_s"):
            rows = profile.simulated.get(option)
            if vars(self).get(option) and rows != ():
                hint = f"set {' and '.join(rows)} as parameters" if rows else "leave it out"
                yield Mistake((option,), f"{profile.family} has no such option", hint)
        for code in vars(self).get("parameters", ()):
            row = profile.parameters.get(code)
            if row is None or row.table.is_bits or row.words != 1:
                hint = "a parameter of one register by its code, such as P314 or C8.2.5.3"
                yield Mistake(("parameters", code), f"{profile.family} has no such parameter", hint)
        for code in self.markers if "markers" in profile.simulated else ():
            if not _is_marker(profile, code):
                hint = "write COIL or DI and its address, such as DI7"
                yield Mistake(("markers", code), f"{profile.family} has no such marker", hint)


def _is_marker(profile: Profile, code: str) -> bool:
    with suppress(CommandError):
        return parameters.find(profile, code).table.is_bits
    return False
