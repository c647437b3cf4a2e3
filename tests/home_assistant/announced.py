"""What a gateway announces of a starter of each family."""

from __future__ import annotations

from functools import cache
from typing import Any

from tests.rig import RigPlant
from tests.rig.sites import FOUR, HOME_ASSISTANT, operator
from tests.scenarios.plugins.doors import device

STARTERS = ("pump", "fan", "mill", "belt")
BUTTONS = HOME_ASSISTANT + 'operator = "ha"\ncommands = true\n'


@cache
def announced() -> dict[str, dict[str, Any]]:
    """Return the discovery of each starter, and of the gateway under an empty name."""
    with RigPlant(FOUR + operator("ha", ("start", "stop", "reset")) + BUTTONS) as plant:
        plant.run(until=5.0)
        return {name: plant.broker.retained[device(name)].json for name in (*STARTERS, "")}
