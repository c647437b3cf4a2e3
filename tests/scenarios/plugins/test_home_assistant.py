"""Home Assistant: what docs/home-assistant.md promises, as its MQTT integration sees it."""

from __future__ import annotations

import re
from typing import Any

from gateway.plugins.homeassistant.entities import GATEWAY_IS_ON
from tests.rig import (
    RigPlant,
    command,
    fault,
    frames,
    msg,
    never,
    played,
    publish,
    reload,
    result,
    results,
    retained,
    row,
    scene,
    seen,
    that,
)
from tests.rig.rows import Expectation
from tests.rig.sites import ALICE, FOUR, HOME_ASSISTANT, QUICK, SSW07, operator, starter
from tests.rig.state import with_document
from tests.scenarios.plugins.doors import device, entity, press, shown

RIGHTS = operator("ha", ("stop", "start", "reset"))
BUTTONS = HOME_ASSISTANT + 'operator = "ha"\ncommands = true\n'
HOME = SSW07 + RIGHTS + BUTTONS
ON, OFF = "05 00 64 ff 00", "05 00 64 00 00"


def entities(name: str, *there: str, missing: tuple[str, ...] = ()) -> Expectation:
    """The device has these entities, and lacks those."""

    def check(plant: RigPlant) -> str:
        found = plant.broker.retained[device(name)].json["components"]
        return (
            "" if set(there) <= found.keys() and not set(missing) & found.keys() else f"{name}: {list(found)}"
        )

    return check


def buttons(there: str) -> Expectation:
    """The pump has these buttons, and what shows their results, and no others."""
    missing = {"stop", "start", "reset", "result"} - set(there.split())
    return entities("pump", "state", *there.split(), missing=tuple(missing))


def one(key: str, name: str = "pump", **fields: Any) -> Expectation:
    """An entity is announced with these fields."""

    def check(plant: RigPlant) -> str:
        found = entity(plant, key, name)
        return "" if fields.items() <= found.items() else str(found)

    return check


DISCOVERY = [
    scene(
        "each starter is a device that belongs to the gateway's, named and made as it says",
        FOUR + RIGHTS + BUTTONS,
        {},
        5.0,
        retained(
            device(""),
            device={"identifiers": ["sg_plant"]},
            origin={"name": "starter-gateway"},
            qos=1,
        ),
        retained(
            device("pump"),
            device={
                "name": "pump",
                "manufacturer": "WEG",
                "via_device": "sg_plant",
                "sw_version": "1.40",
            },
        ),
        retained(device("belt"), device={"manufacturer": "Intecma"}),
        entities("", "status", "boot", "line_pumps"),
    ),
    scene(
        "each device has what its family can fill",
        FOUR + RIGHTS + BUTTONS,
        {},
        5.0,
        *(
            entities(name, "state", "running", "fault", "remote", "online", "current", "trouble", "result")
            for name in ("pump", "fan", "mill", "belt")
        ),
        entities("pump", "fault_code", "thermal_load", "starts_total", missing=("alarm", "torque_pct")),
        entities("fan", "alarm", "active_power", "energy_kwh", missing=("line_voltage", "thermal_load")),
        entities("mill", "alarm", "torque_pct", "power_factor", "output_voltage", "energy_kwh"),
        entities("belt", "line_voltage", "heatsink_temperature", missing=("current_pct", "energy_kwh")),
    ),
    scene(
        "units and classes are those that Home Assistant knows",
        FOUR + RIGHTS + BUTTONS,
        {},
        5.0,
        one("current", unit_of_measurement="A", device_class="current", state_class="measurement"),
        one("energy_kwh", "mill", unit_of_measurement="kWh", state_class="total_increasing"),
        one("fault", platform="binary_sensor", device_class="problem"),
        one(
            "online",
            platform="binary_sensor",
            device_class="connectivity",
            entity_category="diagnostic",
        ),
        one("start", platform="button", qos=0, retain=False, enabled_by_default=False),
        one("stop", platform="button", qos=1, retain=False),
        one("state", unique_id="sg_plant_pump_Estate", default_entity_id="sensor.plant_pump_state"),
        one("remote", enabled_by_default=False),
    ),
    *(
        row(f"{what} has these buttons: {there}", given=given, then={5.0: buttons(there)})
        for what, given, there in (
            ("a starter without an operator", SSW07 + RIGHTS + HOME_ASSISTANT, ""),
            ("one without commands", SSW07 + RIGHTS + HOME_ASSISTANT + 'operator = "ha"\n', "stop result"),
            (
                "one whose operator lacks a right",
                SSW07 + operator("ha", ("stop", "start")) + BUTTONS,
                "stop start result",
            ),
            (
                "one that is not its operator's",
                SSW07 + starter("fan", 2, "ssw06") + operator("ha", ("stop", "start"), ("fan",)) + BUTTONS,
                "",
            ),
            (
                "one with a verb that needs a selection",
                HOME.replace("[[operator]]", '[line.starter.rules]\ntwo_step = ["start"]\n[[operator]]', 1),
                "stop reset result",
            ),
        )
    ),
    scene(
        "prefix and page are those of the configuration",
        SSW07
        + HOME_ASSISTANT
        + 'discovery_prefix = "homeassistant/plant"\npage_url = "https://mcc1.plant:8480/"\n',
        {},
        5.0,
        retained(
            "homeassistant/plant/device/sg_plant_pump/config",
            device={"configuration_url": re.compile("https://mcc1.plant:8480/")},
        ),
    ),
    row(
        "a starter that is never there is announced all the same, and unavailable",
        given=HOME,
        absent=("pump",),
        then={30.0: [shown("state", "unavailable"), shown("online", "offline")]},
    ),
]

SHOWN = [
    row(
        "Home Assistant shows what the starter says, and nothing of it while the gateway is away",
        given=HOME,
        sim={"pump": QUICK},
        at={3.0: command("pump/ha/start"), 10.0: "pump trip E05", 25.0: "kill"},
        then={
            2.9: [
                shown("state", "ready"),
                shown("running", "False"),
                shown("online", "online"),
                shown("fault_code", "None"),
            ],
            9.0: [shown("state", "running"), shown("running", "True"), shown("remote", "True")],
            20.0: [
                shown("state", "fault"),
                shown("fault", "True"),
                shown("fault_code", "5"),
                shown("current", "0.0"),
            ],
            25.1: [shown("state", "unavailable"), shown("online", "unavailable")],
        },
    ),
    scene(
        "a silent starter is unavailable but for its stop, its results and whether it is there",
        HOME,
        {5.0: fault("silent", "pump")},
        20.0,
        shown("state", "unavailable"),
        shown("current", "unavailable"),
        shown("online", "offline"),
        that(
            lambda plant: [entity(plant, key)["availability"] for key in ("stop", "result")],
            2 * [[{"topic": "starters/plant/gateway/status", "value_template": GATEWAY_IS_ON}]],
        ),
    ),
]

PRESSES = [
    row(
        "buttons start, stop and reset, and their results come back",
        given=HOME,
        sim={"pump": QUICK},
        at={5.0: press("start", qos=0), 10.0: press("stop"), 14.0: "pump trip E05", 18.0: press("reset")},
        then={
            9.0: [
                result("start confirmed ok"),
                frames("pump", ON),
                msg("audit", client="ha", verb="start", operator="home-assistant"),
            ],
            13.0: [result("stop confirmed ok"), frames("pump", ON, OFF)],
            24.0: [result("reset confirmed ok"), msg("starter/pump/state", fault=False)],
        },
    ),
    row(
        "a late press is refused, the same press twice acts once, two presses are two commands",
        given=HOME,
        sim={"pump": QUICK},
        at={
            3.0: press("start", late_s=7.0),
            5.0: [press("stop"), press("stop")],
            9.0: press("start"),
            13.0: press("start"),
        },
        then={
            4.5: [result("start rejected expired"), frames("pump")],
            20.0: [
                seen("result/pump/ha", times=2, verb="start", phase="accepted"),
                result("start rejected motor_running"),
            ],
        },
    ),
]


REMOVAL = [
    row(
        "a starter that leaves the configuration is deleted, the others stay",
        given=FOUR + BUTTONS + RIGHTS,
        at={5.0: reload(SSW07 + BUTTONS + RIGHTS)},
        then={
            4.9: retained(device("fan"), components=...),
            8.0: [
                retained(device("fan")),
                retained(device("pump"), components=...),
                retained(device(""), components=...),
            ],
        },
    ),
    row(
        "an end of the gateway deletes nothing, its next start what has left the configuration meanwhile",
        given=FOUR + HOME_ASSISTANT,
        at={5.0: "end", 6.0: lambda plant: plant.write(SSW07 + HOME_ASSISTANT), 7.0: "start"},
        then={
            6.5: retained(device("fan"), components=...),
            12.0: [retained(device("fan")), retained(device("pump"), components=...)],
        },
    ),
    row(
        "one that leaves while the broker is away is deleted when it is back",
        given=FOUR + HOME_ASSISTANT,
        at={5.0: "broker down", 8.0: reload(SSW07 + HOME_ASSISTANT), 20.0: "broker up"},
        then={60.0: [retained(device("fan")), retained(device("pump"), components=...)]},
    ),
    row(
        "a damaged list of what was announced hinders nothing",
        given=SSW07 + HOME_ASSISTANT,
        before=with_document("announced", "no list"),
        then={5.0: [retained(device("pump"), components=...), retained(device(""), components=...)]},
    ),
    row(
        "without the table everything is deleted",
        given=FOUR + HOME_ASSISTANT,
        at={5.0: reload(FOUR), 10.0: reload(FOUR + HOME_ASSISTANT)},
        then={
            9.0: retained("homeassistant/#"),
            14.0: [retained(device("mill"), components=...), retained(device(""), components=...)],
        },
    ),
    row(
        "when Home Assistant begins, or the broker comes back empty, everything is announced again",
        given=SSW07 + HOME_ASSISTANT,
        at={
            10.0: publish("homeassistant/status", b"online", client="ha"),
            40.0: "broker down",
            50.0: lambda plant: plant.broker.start(retained=False),
        },
        then={
            20.0: [seen(device("pump"), times=1, since=10.0), seen(device(""), times=1, since=10.0)],
            90.0: [retained(device("pump"), components=...), retained(device(""), components=...)],
        },
    ),
    row(
        "a device that was deleted there stays deleted until its next start",
        given=SSW07 + HOME_ASSISTANT,
        at={
            10.0: publish(device("pump"), b"", retain=True, client="ha"),
            20.0: publish("homeassistant/status", b"offline", client="ha"),
            25.0: publish("homeassistant/status", b"online", client="ha", retain=False),
        },
        then={24.0: retained(device("pump")), 35.0: retained(device("pump"), components=...)},
    ),
    scene(
        "nothing is said again while nothing changes",
        SSW07 + HOME_ASSISTANT + ALICE,
        {10.0: command("pump/alice/start")},
        40.0,
        never(device("pump"), since=5.0),
        results("start accepted ok", "start written ok", "start confirmed ok"),
        sim={"pump": QUICK},
    ),
]


test_what_home_assistant_shows = played(DISCOVERY + SHOWN + REMOVAL)
test_a_press_of_a_button = played(PRESSES)
