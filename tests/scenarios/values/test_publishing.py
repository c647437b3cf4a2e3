"""When a value, a state and what a starter is are published: by exception, and again after a while."""

from __future__ import annotations

from tests.rig import apart, msg, played, row, scene
from tests.rig.sites import ALICE, SSW06, SSW07, starter, table

CURRENT = "starter/pump/value/current"


EXCEPTION = [
    row(
        "`mqtt.refresh_s` sets how soon",
        given=table("mqtt", url="mqtt://127.0.0.1", refresh_s=20.0) + SSW07,
        then={70: apart(CURRENT, 19.7, 20.3, since=0.6)},
    ),
    row(
        "the state is published every 30 s",
        given=SSW07,
        then={125: apart("starter/pump/state", 29.7, 30.0, since=0.23)},
    ),
    row(
        "a new state is published at once, its booleans with it",
        given=SSW07,
        at={5: "pump VB01 = 0x5123", 6.2: "pump VB01 = 0x4102"},
        then={
            6.2: msg("starter/pump/state", state="running", bypass_closed=True),
            7.4: [
                msg("starter/pump/state", state="ready"),
                apart("starter/pump/state", 1.0, 1.3, since=5),
            ],
        },
    ),
]

INFO = [
    scene(
        "info says what a starter is, and which points and commands it has",
        SSW07 + ALICE,
        {},
        5,
        msg(
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
        ),
        sim={"pump": {"model": "SSW-07 85A"}},
    ),
    scene(
        "an SSW-06's info has its size, an SSW900's the slot of its accessory, an SST's its serial number",
        SSW06 + starter("mill", 3, "ssw900") + starter("belt", 4, "sst"),
        {},
        8,
        msg("starter/fan/info", family="ssw06", rated_current_a=312.0),
        msg("starter/mill/info", family="ssw900", slot=2),
        msg("starter/belt/info", family="sst", serial=...),
        sim={"fan": {"model": "SSW-06 312A"}, "mill": {"slot": 2}},
    ),
]


test_publishing = played(EXCEPTION + INFO)
