"""Communication watchdogs of the starters: set, judged, stored over a restart, changed by others."""

from __future__ import annotations

import pytest

from tests.rig import RigPlant, command, event, fault, msg, played, reload, result, row, scene
from tests.rig.sites import ALICE, SSW07, line, starter
from tests.rig.state import stored_document, with_document
from tests.scenarios.broker.support import codes

SLOW = line(baud=9600)
PUMP = starter("pump", 1, "ssw07")
MANY = "".join(starter(f"p{at}", at, "ssw07", watchdog_s=3.0) for at in range(2, 20))
OTHERS = tuple(f"p{at}" for at in range(2, 20))
USED_FOR_30 = msg("gateway/line/pumps", watchdogs={"load": pytest.approx(0.0016, abs=0.001)})


ROWS = [
    row(
        "a watchdog that the starter refused to take costs the line nothing more",
        given=line() + starter("pump", 1, "ssw07", every_s=20.0) + ALICE,
        sim={"pump": {"settings": {313: 2, 314: 30}}},
        at={
            30.0: [
                fault("refuse", "pump", 4, (6, 16), for_s=5.0),
                command("pump/alice/set", args={"parameter": "P314", "value": 3}),
            ]
        },
        then={29.0: USED_FOR_30, 90.0: [result("set failed server_device_failure"), USED_FOR_30]},
    ),
    row(
        "a reload that would miss a watchdog that was read is refused",
        given=SLOW + PUMP,
        sim={"pump": {"settings": {314: 1}}},
        absent=OTHERS,
        at={15.0: reload(SLOW + PUMP + MANY)},
        then={20.0: [event("reload_refused"), msg("starter/pump/availability", state="online")]},
    ),
    scene(
        "a damaged document of watchdogs is reported, and they are read again",
        SSW07,
        {10.0: ["end", with_document("watchdogs", '{"starters": 7}'), "start"]},
        30.0,
        event("memory_damaged"),
        codes("starter/pump/event"),
    ),
]


test_watchdogs = played(ROWS)


@pytest.mark.parametrize(
    ("family", "parameter", "value"),
    [("ssw06", "P314", 4), ("ssw07", "P314", 3), ("ssw900", "C8.2.5.3", 5), ("sst", "R41", 6)],
)
def test_each_family_has_a_watchdog_that_can_be_set(family: str, parameter: str, value: int) -> None:
    with RigPlant(line() + starter("pump", 1, family) + ALICE) as plant:
        plant.run(until=10.0)
        plant.command("pump/alice/set", args={"parameter": parameter, "value": value})
        plant.run(until=20.0)
        plant.restart()
        plant.run(until=40.0)

        assert plant.results()[-1] == "set confirmed ok"
        assert "parameter_changed" not in plant.events("starter/pump/event")
        assert parameter in stored_document(plant, "watchdogs")["pump"]["rows"]
