"""What an earlier run left retained is cleared at a start, before online; topics of others never."""

from __future__ import annotations

from collections.abc import Callable

from tests.rig import (
    RigPlant,
    event,
    fault,
    msg,
    never,
    played,
    publish,
    reload,
    retained,
    row,
    scene,
    seen,
    that,
)
from tests.rig.sites import SSW07, line, starter
from tests.scenarios.broker.support import HEAL, TRIP

TWO = SSW07 + starter("fan", 2, "ssw06")
AS_SST = line() + starter("pump", 1, "sst")
SWAP = fault("swap", "pump", "sst")


def becomes(toml: str) -> Callable[[RigPlant], None]:
    """Change the configuration while the gateway does not run, and begin."""

    def act(plant: RigPlant) -> None:
        plant.write(toml)
        plant.start()

    return act


def cleared(topic: str, since: float) -> Callable[[RigPlant], str]:
    """Nothing of it is retained, and it was cleared before the gateway said online."""

    def check(plant: RigPlant) -> str:
        if wrong := retained(topic)(plant):
            return wrong
        gone = [each.at_s for each in plant.messages(topic, since) if not each.payload]
        online = [m.at_s for m in plant.messages("gateway/status", since) if m.json["state"] == "online"]
        return "" if gone and online and max(gone) <= online[0] else f"cleared {gone}, online {online}"

    return check


def no_value_of_before(since: float) -> Callable[[RigPlant], str]:
    """Nothing that was published before is retained as a value."""

    def check(plant: RigPlant) -> str:
        values = [each for topic, each in plant.broker.retained.items() if "/value/" in topic]
        return "\n".join(each.topic for each in values if each.at_s < since)

    return check


ALARM = {
    "active": True,
    "severity": "fault",
    "text": "old",
    "time": "2026-11-20T00:00:00.000Z",
    "cleared": None,
    "count": 1,
    "seq": 1,
    "boot": "0123456789abcdef",
}


GHOSTS = [
    row(
        "an alarm that ended while the gateway was away is cleared",
        given=SSW07,
        at={4.0: TRIP, 9.0: "kill", 10.0: HEAL, 12.0: "start"},
        then={
            8.9: retained("starter/pump/alarm/e05", active=True),
            25.0: cleared("starter/pump/alarm/e05", since=12.0),
        },
    ),
    row(
        "an alarm of a starter that is away is left until it answers",
        given=SSW07,
        at={4.0: TRIP, 9.0: "kill", 10.0: [HEAL, fault("silent", "pump", for_s=30.0)], 12.0: "start"},
        then={
            35.0: [
                retained("starter/pump/alarm/e05", active=True),
                msg("starter/pump/availability", state="offline"),
            ],
            60.0: retained("starter/pump/alarm/e05"),
        },
    ),
    scene(
        "a line and a starter that were taken out between two runs are cleared whole, the others stay",
        SSW07 + line("hall") + starter("fan", 2, "ssw06"),
        {8.0: "kill", 9.0: becomes(SSW07)},
        25.0,
        cleared("starter/fan/#", since=9.0),
        cleared("gateway/line/hall", since=9.0),
        retained("starter/pump/info", family="ssw07"),
        retained("gateway/line/pumps", is_open=True),
    ),
    row(
        "what fits no topic or field of the contract is somebody else's and stays",
        given=SSW07,
        before=lambda plant: [
            plant.publish(topic, payload, client="other", retain=True)
            for topic, payload in (
                ("notes/pump", {"text": "x"}),
                ("starter/fan/note", {"text": "x"}),
                ("command/fan/alice/stop", b"x"),
                ("starter/fan/state", b"running"),
                ("starter/pump/value/vibration", {"value": 3.2}),
                ("/plant/starter/fan/state", {"state": "ready"}),
            )
        ],
        then={
            20.0: [
                msg("gateway/status", state="online"),
                that(lambda plant: sum(m.client == "other" for m in plant.broker.retained.values()), 6),
            ]
        },
    ),
    scene(
        "a broker that does not let the gateway read its leftovers is named, and nothing is cleared",
        TWO,
        {
            8.0: "kill",
            8.5: lambda plant: plant.broker.deny("*", "starters/plant/starter/#", "read"),
            9.0: becomes(SSW07),
        },
        25.0,
        event("leftovers_unread", severity="warning"),
        retained("starter/fan/info", family="ssw06"),
        msg("gateway/status", state="online"),
    ),
    row(
        "another gateway under the same base is an event, once, and what it retains is not cleared",
        given=SSW07,
        before=lambda plant: (
            plant.publish("starter/fan/alarm/e99", ALARM, client="b", retain=True),
            plant.publish("gateway/status", {"state": "online", "run": "ff"}, client="b", retain=True),
        ),
        at={
            0.5 + n: publish("gateway/fresh", {"token": f"t{n}"}, client="b", retain=True) for n in range(20)
        },
        then={
            30.0: [
                seen("gateway/event", code="base_shared", severity="error", times=1),
                retained("starter/fan/alarm/e99", active=True),
            ]
        },
    ),
    row(
        "a family that was changed between two runs leaves no value of the former one",
        given=SSW07,
        at={8.0: "kill", 8.5: SWAP, 9.0: becomes(AS_SST)},
        then={30.0: [retained("starter/pump/info", family="sst"), no_value_of_before(9.0)]},
    ),
    row(
        "a family that a reload changes leaves no value of the former one",
        given=SSW07,
        at={8.0: [SWAP, reload(AS_SST)]},
        then={30.0: [retained("starter/pump/info", family="sst"), no_value_of_before(8.0)]},
    ),
    row(
        "a connection that is lost while the leftovers are read is followed by another reading",
        given=TWO,
        at={8.0: "kill", 9.0: [becomes(SSW07), "broker drops"]},
        then={30.0: [cleared("starter/fan/#", since=9.0), msg("gateway/status", state="online")]},
    ),
    row(
        "the status of a gateway that died with its broker prevents nothing",
        given=SSW07,
        before=lambda plant: (
            plant.publish("starter/pump/alarm/e99", ALARM, client="b", retain=True),
            plant.publish("gateway/status", {"state": "online", "run": "ff"}, client="b", retain=True),
        ),
        then={
            5.5: [  # its heartbeat would have come by then
                retained("starter/pump/alarm/e99"),
                never("gateway/event", code="base_shared"),
                msg("gateway/status", state="online"),
            ]
        },
    ),
    row(
        "nothing that was never published is cleared at a first start",
        given=SSW07,
        then={20.0: lambda plant: "\n".join(m.topic for m in plant.messages("#") if not m.payload)},
    ),
]


test_ghosts = played(GHOSTS)
