"""Events of a starter: starts, stops, faults with their numbers, alarms, local operation."""

from __future__ import annotations

import re
from typing import Any

import pytest

from tests.rig import command, msg, never, played, result, retained, row, scene, seen
from tests.rig.rows import Expectation
from tests.rig.sites import ALICE, QUICK, SITES, SST, SSW07, SSW900


def of(starter: str, code: str, **fields: Any) -> Expectation:
    """Exactly one such event of a starter."""
    return seen(f"starter/{starter}/event", times=1, code=code, retain=False, qos=1, **fields)


def no(starter: str, code: str) -> Expectation:
    return never(f"starter/{starter}/event", code=code)


READY, RUNNING, TRIPPED = "pump VB01 = 0x4102", "pump VB01 = 0x5123", "pump VB01 = 0x8000"

MOTORS = [
    row(
        "a start and a stop are an event each, the stop with the seconds between",
        given=SSW07,
        at={0: READY, 3: RUNNING, 13: READY},
        then={
            12: [of("pump", "started", severity="info", data={"from": "ready", "to": "running"})],
            16: [
                of("pump", "started"),
                of(
                    "pump",
                    "stopped",
                    data={"from": "running", "to": "ready", "run_s": pytest.approx(10, abs=1.1)},
                ),
                no("pump", "fault"),
            ],
        },
    ),
]

TRIPS = [
    row(
        "an SSW-07 trips with the number of P014: state, alarm, event and the record of the trip",
        given=SSW07,
        at={0: RUNNING, 5: [TRIPPED, "pump P014 = 5"]},
        then={
            7.5: [
                msg("starter/pump/state", state="fault", fault_code=5),
                msg(
                    "starter/pump/alarm/e05",
                    active=True,
                    severity="fault",
                    count=1,
                    cleared=None,
                    retain=True,
                ),
                of(
                    "pump", "fault", severity="error", data={"alarm": "e05", "from": "running", "to": "fault"}
                ),
            ],
            30: msg("starter/pump/trip", code="e05", state_before="running", text=re.compile("overload")),
        },
    ),
    row(
        "a fault that goes and comes again is counted",
        given=SSW07,
        sim={"pump": QUICK},
        at={3: "pump trip E05", 10: "pump clear", 20: "pump trip E05"},
        then={
            9: msg("starter/pump/alarm/e05", active=True, count=1, cleared=None),
            15: [
                retained("starter/pump/alarm/e05", active=False, count=1, cleared=...),
                of("pump", "cleared", data={"alarm": "e05", "count": 1}),
                msg("starter/pump/state", state="ready"),
            ],
            25: [
                msg("starter/pump/alarm/e05", active=True, count=2, cleared=None),
                seen("starter/pump/event", times=2, code="fault"),
            ],
        },
    ),
    row(
        "the same fault in the run after next is an event again when another was between",
        given=SSW07,
        at={
            0: [TRIPPED, "pump P014 = 5"],
            8: ["end", "pump P014 = 7", "start"],
            16: ["end", "pump P014 = 5", "start"],
        },
        then={24: seen("starter/pump/event", times=3, code="fault")},
    ),
]

TRIPPED_BY = {"pump": "E05", "fan": "E05", "mill": "F005", "belt": "COIL12"}
TRIPS += [
    row(
        f"the fault of a motor that was running is reset without starting it ({name})",
        given=SITES[name] + ALICE,
        sim={name: QUICK},
        at={
            3: command(f"{name}/alice/configure" if name == "belt" else f"{name}/alice/stop"),
            9: command(f"{name}/alice/start"),
            20: f"{name} trip {number}",
            26: command(f"{name}/alice/reset"),
        },
        then={
            25: [
                of(name, "fault", data={"from": "running", "before": ...}),
                seen(f"starter/{name}/alarm/+", active=True, severity="fault"),
            ],
            50: [
                result("reset confirmed ok"),
                never(f"starter/{name}/state", since=26, running=True),
                never(f"starter/{name}/state", since=45, state="fault"),
                seen(f"starter/{name}/alarm/+", active=False),
            ],
        },
    )
    for name, number in TRIPPED_BY.items()
]

TRIPS += [
    scene(
        "several faults at once are an alarm each, and one event",
        SST,
        {0: "belt R19 = 2", 5: ["belt COIL9 = 1", "belt COIL12 = 1", "belt COIL17 = 1", "belt R19 = 0"]},
        8,
        of("belt", "fault", data={"alarm": "coil12"}, text=re.compile("Overcurrent.*Phase loss")),
        msg("starter/belt/alarm/coil12", active=True, text=re.compile("Overcurrent")),
        msg("starter/belt/alarm/coil17", active=True, text=re.compile("Phase loss")),
    )
]

ALARMS = [
    row(
        "an SSW900's alarms come and go by their numbers, and trip nothing",
        given=SSW900,
        at={
            0: "mill S5.1.1 = 0x0163",
            4: ["mill S5.1.1 = 0x4163", "mill D2.1.1 = 5", "mill D2.1.2 = 66"],
            10: "mill D2.1.2 = 0",
            15: ["mill S5.1.1 = 0x0163", "mill D2.1.1 = 0"],
        },
        then={
            8: [
                msg("starter/mill/state", state="running", alarm=True),
                msg("starter/mill/alarm/a005", active=True, severity="alarm", count=1, cleared=None),
                msg("starter/mill/alarm/a066", active=True, severity="alarm"),
                seen("starter/mill/event", times=2, code="alarm", severity="warning"),
            ],
            14: [
                msg("starter/mill/alarm/a005", active=True),
                msg("starter/mill/alarm/a066", active=False, cleared=...),
                seen("starter/mill/event", times=1, code="cleared"),
            ],
            20: [msg("starter/mill/alarm/a005", active=False), no("mill", "fault")],
        },
    ),
]


test_events = played(MOTORS + TRIPS + ALARMS)
