"""Logins, versions, rights and other clients: what the gateway makes of the broker that it has."""

from __future__ import annotations

import re

from tests.rig import (
    RigPlant,
    clean_line,
    command,
    event,
    msg,
    never,
    played,
    publish,
    result,
    results,
    retained,
    row,
    scene,
    seen,
    that,
)
from tests.rig.sites import ALICE, QUICK, SSW07, table
from tests.scenarios.broker.support import TRIP, afresh, broker, codes, count

MQTT_3 = table("mqtt", url="mqtt://127.0.0.1", version="3.1.1")


def no_session(plant: RigPlant) -> str:
    """The broker keeps no session of the gateway, so that no command waits while that is away."""
    return "" if all(each.is_clean for each in plant.broker.connections) else "it has a session"  # type: ignore[attr-defined]


def _logins(at_least: int, at_most: int):  # type: ignore[no-untyped-def]
    return that(lambda plant: at_least <= len(plant.broker.logins) <= at_most)


REFUSED = [
    row(
        "a broker that refuses the login is tried again, the line is polled on, no password is shown",
        given=SSW07 + table("mqtt", url="mqtt://127.0.0.1", username="mcc1", password_file="mqtt.password"),
        files={"mqtt.password": "s3cret\n"},
        before=broker(refuses=0x86),  # bad user name or password
        at={60.0: broker(refuses=None)},
        then={
            59.0: [count("#", 0), _logins(14, 70)],
            75.0: [
                seen("gateway/event", code="broker_away", text=re.compile("check username"), times=1),
                retained("gateway/status", state="online"),
                clean_line,
                afresh(60.0),
                that(lambda plant: plant.last("gateway/line/pumps")["answered"] > 60),
                that(lambda plant: {login[1:] for login in plant.broker.logins}, {("mcc1", "s3cret")}),
                that(lambda plant: "s3cret" not in plant.transcript()),
            ],
        },
    ),
]

VERSIONS = [
    row(
        "a broker of MQTT 3.1.1 has the whole contract: telemetry, commands, results, will",
        given=SSW07 + ALICE,
        sim={"pump": QUICK},
        before=broker(speaks_5=False),
        at={4.0: command("pump/alice/start"), 8.0: command("pump/alice/stop"), 14.0: "broker drops"},
        then={
            13.0: [
                event("mqtt_3_1_1", severity="warning"),
                retained("gateway/info", mqtt_version="3.1.1"),
                no_session,
                retained("starter/pump/value/current", quality="good"),
                results(
                    *("start accepted ok", "start written ok", "start confirmed ok"),
                    *("stop accepted ok", "stop written ok", "stop confirmed ok"),
                ),
            ],
            14.0: retained("gateway/status", state="offline"),
            20.0: [
                retained("gateway/status", state="online"),
                seen("gateway/event", code="mqtt_3_1_1", times=1),
            ],
        },
    ),
    row(
        "a configuration that asks for MQTT 3.1.1 has it from a broker of MQTT 5",
        given=SSW07 + MQTT_3,
        then={4.0: [retained("gateway/info", mqtt_version="3.1.1"), event("mqtt_3_1_1")]},
    ),
    row(
        "a broker that learns MQTT 5 is spoken to in it at the next connection",
        given=SSW07,
        before=broker(speaks_5=False),
        at={5.0: [broker(speaks_5=True), "broker drops"]},
        then={10.0: [event("mqtt_5"), retained("gateway/info", mqtt_version="5"), no_session]},
    ),
    row(
        "MQTT 5 gives a result the correlation data of its command, on its own topic whatever was asked for",
        given=SSW07 + ALICE,
        sim={"pump": QUICK},
        at={
            4.0: publish(
                "command/pump/alice/stop",
                {"id": "x"},
                client="alice",
                response_topic="starters/g/result/pump/bob",
                correlation=b"7",
            )
        },
        then={7.0: that(lambda plant: {m.correlation for m in plant.messages("result/pump/alice")}, {b"7"})},
    ),
    row(
        "a live retained stop stops in MQTT 5, and a stored one never",
        given=SSW07 + ALICE,
        at={4.0: publish("command/pump/alice/stop", b"", client="alice", retain=True), 10.0: "broker drops"},
        then={
            9.0: [
                result("stop confirmed ok"),
                that(lambda plant: bool(plant.starter("pump").writes)),
            ],
            20.0: that(lambda plant: plant.starter("pump").writes[-1][0] < 10.0),
        },
    ),
]


OTHERS = [
    scene(
        "another client with the gateway's id is an event, once until a connection has held",
        SSW07,
        {5.0 + 2 * n: (lambda plant: plant.broker.drop(code=0x8E)) for n in range(4)},
        30.0,
        seen("gateway/event", code="client_id_taken", severity="error", times=1),
        msg("gateway/status", state="online"),
        clean_line,
    ),
    row(
        "a broker that closes three young connections without a reason may have another client with this id",
        given=SSW07,
        at={5.0 + 3 * n: "broker drops" for n in range(5)},
        then={40.0: seen("gateway/event", code="client_id_taken", text=re.compile("may be using"), times=1)},
    ),
    row(
        "a gateway that returns to its broker takes itself for no other",
        given=SSW07,
        at={5.0: "broker drops", 10.0: "kill", 11.0: "start", 20.0: "restart"},
        then={40.0: [never("gateway/event", code="base_shared"), msg("gateway/status", state="online")]},
    ),
]

RIGHTS = [
    row(
        "messages that the broker refuses are counted, reported once, and not tried again",
        given=SSW07,
        before=lambda plant: plant.broker.deny("*", "starters/plant/starter/pump/value/current", "write"),
        at={6.0: "pump P003 = 100"},
        then={
            40.0: [
                seen("gateway/event", code="publish_refused", severity="error", times=1),
                never("starter/pump/value/current"),
                that(lambda plant: plant.last("gateway/outbox")["refused"] >= 1),
                msg("gateway/status", state="online"),
            ]
        },
    ),
    row(
        "a gateway that may not read commands says that it is deaf to them",
        given=SSW07 + ALICE,
        before=lambda plant: plant.broker.deny("*", "starters/plant/command/#", "read"),
        then={6.0: retained("gateway/status", state="degraded", reason=re.compile("command"))},
    ),
    row(
        "a message larger than the broker takes is set aside, and the rest is sent",
        given=SSW07,
        before=broker(connack={"MaximumPacketSize": 1000}),
        then={
            10.0: [
                event("publish_refused"),
                never("starter/pump/info"),
                msg("starter/pump/state", quality="good"),
                msg("gateway/status", state="online"),
            ]
        },
    ),
    row(
        "a slow broker holds neither the line nor a stop",
        given=SSW07 + ALICE,
        before=broker(ack_after_s=2.0),
        at={10.0: command("pump/alice/stop", fresh=False), 10.5: TRIP},
        then={
            10.6: that(lambda plant: bool(plant.starter("pump").writes)),
            40.0: [codes("starter/pump/event", "fault"), result("stop confirmed ok"), clean_line],
        },
    ),
]


test_a_connection = played(REFUSED + VERSIONS + OTHERS + RIGHTS)
