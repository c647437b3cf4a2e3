"""A scenario in virtual time: a whole gateway on the rig of five doors, and a row of the report."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass

from tests.lab.torture.scenario import Row
from tests.rig import RigPlant
from tests.rig.sites import ALICE, FOUR, QUICK

STARTERS = ("pump", "fan", "mill", "belt")
KNOWN_S = 5.0  # until all starters are online and identified


@dataclass(frozen=True)
class RigScenario:
    """What is tried on a plant of all four families, how much of it, and with which chance."""

    name: str
    attempt: Callable[[RigPlant, Row, int, int], None]  # plant, row to fill, count, seed
    whole: int
    short: int
    unit: str  # of the count

    def row(self, count: int, seed: int) -> Row:
        """Try it and return what came of it."""
        row = Row(self.name, f"{count} {self.unit}")
        began_s = time.monotonic()
        logging.disable(logging.WARNING)  # a bug is logged as an error, which the rig finds
        try:
            with RigPlant(FOUR + ALICE, sim=dict.fromkeys(STARTERS, QUICK), seed=seed) as plant:
                plant.run(until=KNOWN_S)
                self.attempt(plant, row, count, seed)
        except AssertionError as error:
            row.failures.append(str(error))
        finally:
            logging.disable(logging.NOTSET)
        row.took_s = time.monotonic() - began_s
        return row
