"""Simulated starters by family and model, set up so that a start through Modbus works."""

from __future__ import annotations

import re
from dataclasses import fields, replace
from typing import Any

from gateway.sim.core.setup import Quirks
from gateway.sim.sst.unit import Sst
from gateway.sim.ssw900.unit import Ssw900
from gateway.sim.weg.ssw06 import Ssw06
from gateway.sim.weg.ssw07 import Ssw07

_FAMILIES: dict[str, type[Ssw06 | Ssw07 | Ssw900 | Sst]] = {
    each.family: each for each in (Ssw06, Ssw07, Ssw900, Sst)
}
_QUIRKS = {each.name for each in fields(Quirks)}
_CURRENT = re.compile(r"(\d+(?:\.\d+)?)A?")  # a word of "SSW-07 85.0A", "SSW-06 820 A", "85"


def make_unit(
    family: str, address: int, *, model: str | None = None, **options: Any
) -> Ssw06 | Ssw07 | Ssw900 | Sst:
    """Return a starter; `options` are those of `Setup` and `Quirks`. ValueError for an unknown family."""
    maker = _FAMILIES.get(family)
    if maker is None:
        raise ValueError(f"family {family!r} is not one of {', '.join(_FAMILIES)}")
    quirks = Quirks(**{name: options.pop(name) for name in _QUIRKS & options.keys()})
    setup = replace(maker.delivered, **{**_of_model(family, model), **options})
    return maker(address, setup, quirks)


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
