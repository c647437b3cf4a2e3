"""When a value, a state and what a starter is are published: by exception, and again after a while."""

from __future__ import annotations

from itertools import pairwise

import pytest

from tests.rig import RigPlant, ScenarioRow, msg, play, row
from tests.rig.rows import Expectation
from tests.rig.sites import ALICE, SSW06, SSW07, starter, table

CURRENT = "starter/pump/value/current"


def _apart(topic: str, at_least_s: float, *, since: float, most_s: float = 1e9) -> Expectation:
    """The messages of a topic are so far apart, and there are several."""

    def check(plant: RigPlant) -> str:
        times = [each.at_s for each in plant.messages(topic, since)]
        gaps = [later - sooner for sooner, later in pairwise(times)]
        is_so = bool(gaps) and min(gaps) >= at_least_s - 0.001 and max(gaps) <= most_s
        return "" if is_so else f"{topic}: {gaps}"

    return check


def _every_number_is_new(plant: RigPlant) -> str:
    """The same topic never has a `seq` twice."""
    pairs = [(each.topic, each.json["seq"]) for each in plant.messages("starter/pump/value/+")]
    return "" if len(pairs) == len(set(pairs)) else "a number was used twice"


EXCEPTION = [
    row(
        "`mqtt.refresh_s` sets how soon",
        given=table("mqtt", url="mqtt://127.0.0.1", refresh_s=20.0) + SSW07,
        then={70: _apart(CURRENT, 19.7, since=0.6, most_s=20.3)},
    ),
    row(
        "the state is published every 30 s",
        given=SSW07,
        then={125: _apart("starter/pump/state", 29.7, since=0.23, most_s=30.0)},
    ),
    row(
        "a new state is published at once, its booleans with it",
        given=SSW07,
        at={5: "pump VB01 = 0x5123", 6.2: "pump VB01 = 0x4102"},
        then={
            6.2: msg("starter/pump/state", state="running", bypass_closed=True),
            7.4: [
                msg("starter/pump/state", state="ready"),
                _apart("starter/pump/state", 1.0, since=5, most_s=1.3),
            ],
        },
    ),
    row(
        "no number names two messages of a topic",
        given=SSW07,
        at={5: "pump VB01 = 0x5123", 8: "pump VB01 = 0x4102"},
        then={320: _every_number_is_new},
    ),
]

INFO = [
    row(
        "info says what a starter is, and which points and commands it has",
        given=SSW07 + ALICE,
        sim={"pump": {"model": "SSW-07 85A"}},
        then={
            5: msg(
                "starter/pump/info",
                retain=True,
                family="ssw07",
                model="SSW-07 85.0A",
                firmware="1.40",
                rated_current_a=85.0,
                line="pumps",
                address=1,
                points={
                    "current": {"code": "P003", "unit": "A", "type": "float", "deadband": 0.5},
                    "running": {"type": "boolean"},
                    "p006": {"type": "enum", "enum": {"5": "PASS (bypass)"}},
                },
            )
        },
    ),
    row(
        "an SSW-06's info has its size, an SSW900's the slot of its accessory, an SST's its serial number",
        given=SSW06 + starter("mill", 3, "ssw900") + starter("belt", 4, "sst"),
        sim={"fan": {"model": "SSW-06 312A"}, "mill": {"slot": 2}},
        then={
            8: [
                msg("starter/fan/info", family="ssw06", rated_current_a=312.0),
                msg("starter/mill/info", family="ssw900", slot=2),
                msg("starter/belt/info", family="sst", serial=...),
            ]
        },
    ),
]


@pytest.mark.parametrize("row", EXCEPTION + INFO)
def test_publishing(row: ScenarioRow) -> None:
    play(row)
