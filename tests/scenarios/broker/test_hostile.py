"""Payloads that are wrong, topics that are mistyped, and floods: one answer with a reason, and stops pass."""

from __future__ import annotations

import json
from typing import Any

from tests.rig import (
    RigPlant,
    clean_line,
    command,
    frames,
    msg,
    never,
    played,
    publish,
    result,
    results,
    row,
    scene,
    seen,
    that,
)
from tests.rig.broker import MqttMessage
from tests.rig.sites import ALICE, QUICK, SSW07, operator
from tests.scenarios.broker.support import count

START, STOP = "05 00 64 ff 00", "05 00 64 00 00"


def payload(text: bytes | str) -> Any:
    """Publish this on the start's topic, with a right token where it stands as TOKEN."""

    def act(plant: RigPlant) -> None:
        body = text if isinstance(text, bytes) else text.replace("TOKEN", plant.token()).encode()
        plant.publish("command/pump/alice/start", body, client="alice")

    return act


GOOD = '"id": "1", "token": "TOKEN"'
BAD_PAYLOADS = {
    "nothing": "",
    "no text": b"\xff\xfe\x00",
    "no id": '{"token": "TOKEN"}',
    "seventeen expectations": "{" + GOOD + ', "expect": ' + json.dumps({f"p{n}": 1 for n in range(17)}) + "}",
    "an expectation of a point that is not there": "{" + GOOD + ', "expect": {"colour": 1}}',
    "five kilobytes": "{" + GOOD + ', "reason": "' + 5000 * "x" + '"}',
}
STOP_PAYLOADS = {
    "nothing": b"",
    "noise": bytes(range(256)),
    "an unknown key": b'{"id": "1", "speed": 1}',
    "five kilobytes": b"x" * 5000,
    "a wrong boot": b'{"id": "1", "boot": "0000000000000000"}',
}
MISTYPED = {  # with the answer, where the topic has a starter and a client
    "command/pump/alice/STOP": "STOP rejected malformed_topic",
    "command/pump/Alice/start": "",
    "command/pump/alice/start/": "start/ rejected malformed_topic",
    "command/pump/alice/frobnicate": "frobnicate rejected unknown_verb",
}


def sentence(plant: RigPlant) -> str:
    """Each refusal says why, in a sentence."""
    found = [each.json for each in plant.messages("result/#")]
    return "" if found and all(len(each["text"]) > 10 for each in found) else str(found)


PAYLOADS = [
    scene(
        f"a start with {what} is rejected with a reason and writes nothing",
        SSW07 + ALICE,
        {4.0: payload(body)},
        6.0,
        seen("result/pump/alice", times=1, phase="rejected", verb="start"),
        count("result/#", 1),
        sentence,
        frames("pump"),
        seen("audit", times=1, decision="rejected", verb="start"),
    )
    for what, body in BAD_PAYLOADS.items()
]

STOPS = [
    scene(
        f"a stop with {what} as its payload stops",
        SSW07 + ALICE,
        {3.0: command("pump/alice/start"), 6.0: publish("command/pump/alice/stop", body, client="alice")},
        10.0,
        result("stop confirmed ok"),
        frames("pump", STOP, since=6.0),
        msg("starter/pump/state", state="ready"),
        sim={"pump": QUICK},
    )
    for what, body in STOP_PAYLOADS.items()
]

TOPICS = [
    scene(
        f"a command on {topic} does nothing, and is reported",
        SSW07 + ALICE,
        {
            4.0: lambda plant, topic=topic: plant.publish(
                topic, {"id": "1", "token": plant.token()}, client="alice"
            )
        },
        6.0,
        seen("gateway/event", code="malformed_topic", severity="warning", times=1),
        results(*filter(None, (said,))),
        frames("pump"),
        seen("audit", times=1, decision="rejected"),
    )
    for topic, said in MISTYPED.items()
]

REFUSED = [
    row(
        "a start of a starter that is not configured is refused",
        given=SSW07 + ALICE,
        at={4.0: command("ghost/alice/start")},
        then={5.0: [result("start rejected unknown_starter", starter="ghost")]},
    ),
]


def flood(verb: str, many: int, client: str = "alice", **fields: Any) -> Any:
    """Publish so many commands at once, each with its own id."""

    def act(plant: RigPlant) -> None:
        token = plant.token()
        for number in range(many):
            body = json.dumps({"id": f"f-{client}-{number}", "token": token, **fields})
            plant.broker.publish(_message(plant, f"command/pump/{client}/{verb}", body, client))

    return act


def _message(plant: RigPlant, topic: str, body: str, client: str) -> Any:
    return MqttMessage(plant.world.now_s(), plant.topic(topic), body.encode(), 1, client=client)


def _one_answer_each(plant: RigPlant) -> str:
    finals = [
        m.json for m in plant.messages("result/pump/alice") if m.json["phase"] in ("confirmed", "rejected")
    ]
    named = [each["id"] for each in finals if each["id"]]
    counted = sum(each.get("count", 0) for each in finals if not each["id"])
    return (
        "" if len(named) == len(set(named)) and len(named) + counted == 500 else f"{len(named)} and {counted}"
    )


FLOODS = [
    scene(
        "of 500 starts at once one starts, and every other is refused once or counted",
        SSW07 + ALICE,
        {4.0: flood("start", 500)},
        15.0,
        frames("pump", START),
        _one_answer_each,
        seen("result/pump/alice", code="too_many"),
        seen("result/pump/alice", code="busy"),
        sim={"pump": QUICK},
    ),
    row(
        "a stop behind 500 starts is on the line first",
        given=SSW07 + ALICE,
        at={4.0: [flood("start", 500), command("pump/alice/stop", fresh=False)]},
        then={4.5: [that(lambda plant: plant.starter("pump").writes[-1][1], STOP)]},
    ),
    row(
        "one client's flood takes nothing from another",
        given=SSW07 + ALICE + operator("bob"),
        at={
            4.0: flood("read", 400, args={"parameter": "P003"}),
            12.0: command("pump/bob/read", args={"parameter": "P003"}),
        },
        then={14.0: result("read confirmed ok", client="bob")},
    ),
    scene(
        "stops are never limited: 100 at once are carried out, with frames in moderation",
        SSW07 + ALICE,
        {4.0: flood("stop", 100)},
        30.0,
        never("result/pump/alice", phase="failed"),
        seen("result/pump/alice", code="too_many", id=None, count=...),
        that(lambda plant: 8 <= len(plant.starter("pump").writes) <= 40),
        msg("starter/pump/state", state="ready", quality="good"),
        clean_line,
    ),
    scene(
        "a flood of mistyped topics is one event a second, with its count",
        SSW07 + ALICE,
        {
            4.0: lambda plant: [
                plant.publish("command/pump/alice/START", b"x", client="alice") for _ in range(300)
            ]
        },
        10.0,
        count("gateway/event", 6, since=4.0, at_least=1),
        seen("gateway/event", code="malformed_topic"),
    ),
    scene(
        "a flood costs the polls nothing",
        SSW07 + ALICE,
        {4.0 + n / 10: flood(f"start{n}", 30) for n in range(40)},
        12.0,
        msg("starter/pump/availability", state="online"),
        never("starter/pump/value/current", quality="stale"),
    ),
]


test_what_arrives = played(PAYLOADS + STOPS + TOPICS + REFUSED + FLOODS)
