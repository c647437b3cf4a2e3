"""Simulated starters by family and model, set up so that a start through Modbus works."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

from gateway.sim.core.unit import SimulatedUnit
from gateway.sim.sst.motion import SstMotion
from gateway.sim.sst.unit import Sst
from gateway.sim.ssw900.unit import Ssw900
from gateway.sim.weg.common import Commanded
from gateway.sim.weg.ssw06 import Ssw06
from gateway.sim.weg.ssw07 import Ssw07

_CURRENT = re.compile(r"(\d+(?:\.\d+)?)A?")  # a word of "SSW-07 85.0A", "SSW-06 820 A", "85"


def make_unit(
    family: str, address: int, *, seed: int = 0, model: str | None = None, **options: Any
) -> SimulatedUnit:
    """Return a starter; `options` are those of the family's class. ValueError for an unknown family."""
    maker = _MAKERS.get(family)
    if maker is None:
        raise ValueError(f"family {family!r} is not one of {', '.join(_MAKERS)}")
    hides_command_bits = options.pop("hides_command_bits", False)
    unit = maker(address, seed=seed, **_of_model(family, model), **options)
    unit.hides_command_bits = hides_command_bits
    return unit


_MAKERS: dict[str, Callable[..., Commanded | SstMotion]] = {
    "ssw06": Ssw06,
    "ssw07": Ssw07,
    "ssw900": Ssw900,
    "sst": Sst,
}


def _of_model(family: str, model: str | None) -> dict[str, Any]:
    if model is None:
        return {}
    if family == "sst":
        return {"model": model}
    found: dict[str, Any] = {}
    currents = [match for each in model.split() if (match := _CURRENT.fullmatch(each))]
    if currents:
        found["rated_current_a"] = float(currents[0][1])
    if family == "ssw07" and model.startswith("SSW-08"):
        found["product"] = "SSW-08"
    return found
