"""Payloads that are wrong, topics that are mistyped, and floods: one answer with a reason, and stops pass."""

from __future__ import annotations

import json
import random
from typing import Any

import pytest

from tests.rig import (
    RigPlant,
    ScenarioRow,
    clean_line,
    command,
    frames,
    msg,
    never,
    play,
    publish,
    result,
    results,
    row,
    seen,
)
from tests.rig.broker import MqttMessage
from tests.rig.sites import ALICE, QUICK, SSW07, operator
from tests.scenarios.broker.support import count

START, STOP = "05 00 64 ff 00", "05 00 64 00 00"
DEEP = "[" * 1500 + "]" * 1500


def payload(text: bytes | str) -> Any:
    """Publish this on the start's topic, with a right token where it stands as TOKEN."""

    def act(plant: RigPlant) -> None:
        body = text if isinstance(text, bytes) else text.replace("TOKEN", plant.token()).encode()
        plant.publish("command/pump/alice/start", body, client="alice")

    return act


GOOD = '"id": "1", "token": "TOKEN"'
BAD_PAYLOADS = {
    "nothing": "",
    "no JSON": "start!",
    "no object": "[1, 2]",
    "half an object": '{"id": "1"',
    "two objects": "{" + GOOD + "}{}",
    "no text": b"\xff\xfe\x00",
    "a key twice": "{" + GOOD + ', "id": "2"}',
    "an unknown key": "{" + GOOD + ', "speed": 1}',
    "no id": '{"token": "TOKEN"}',
    "an empty id": '{"id": "", "token": "TOKEN"}',
    "an id of a kilobyte": '{"id": "' + 1000 * "x" + '", "token": "TOKEN"}',
    "a number as id": '{"id": 1, "token": "TOKEN"}',
    "a null id": '{"id": null, "token": "TOKEN"}',
    "NaN": "{" + GOOD + ', "ttl_s": NaN}',
    "a number that is too large": "{" + GOOD + ', "ttl_s": 1e999}',
    "no time to live": "{" + GOOD + ', "ttl_s": 0}',
    "a time to live of an hour": "{" + GOOD + ', "ttl_s": 3600}',
    "a negative time to live": "{" + GOOD + ', "ttl_s": -5}',
    "args that are no object": "{" + GOOD + ', "args": [1]}',
    "arguments that a start has not": "{" + GOOD + ', "args": {"parameter": "P314"}}',
    "expectations that are no object": "{" + GOOD + ', "expect": "ready"}',
    "seventeen expectations": "{" + GOOD + ', "expect": ' + json.dumps({f"p{n}": 1 for n in range(17)}) + "}",
    "an expectation of a point that is not there": "{" + GOOD + ', "expect": {"colour": 1}}',
    "a time without an offset": '{"id": "1", "issued_at": "2026-11-21T00:00:04"}',
    "a time that is none": '{"id": "1", "issued_at": "soon"}',
    "a thousand brackets": '{"id": "1", "args": ' + DEEP + "}",
    "five kilobytes": "{" + GOOD + ', "reason": "' + 5000 * "x" + '"}',
    "a surrogate": '{"id": "\\ud800", "token": "TOKEN"}',
    "a zero byte": '{"id": "a\\u0000", "token": "TOKEN"}',
}
STOP_PAYLOADS = {
    "nothing": b"",
    "a word": b"now!",
    "noise": bytes(range(256)),
    "half an object": b'{"id": "1"',
    "an unknown key": b'{"id": "1", "speed": 1}',
    "a wrong token": b'{"id": "1", "token": "x"}',
    "an old time": b'{"id": "1", "issued_at": "2020-01-01T00:00:00Z"}',
    "five kilobytes": b"x" * 5000,
    "a wrong boot": b'{"id": "1", "boot": "0000000000000000"}',
}
MISTYPED = {  # with the answer, where the topic has a starter and a client
    "command/pump/alice/STOP": "STOP rejected malformed_topic",
    "command/PUMP/alice/start": "start rejected malformed_topic",
    "command/pump/Alice/start": "",
    "command/pump/alice/start/": "start/ rejected malformed_topic",
    "command/pump/alice/start/now": "start/now rejected malformed_topic",
    "command/pump/alice": "",
    "command//alice/start": "",
    "command/pump//start": "",
    "command": "",
    "command/pump/alice/st art": "st art rejected malformed_topic",
    "command/pump/alice/frobnicate": "frobnicate rejected unknown_verb",
    "command/pump/alice/configure": "configure rejected unknown_verb",
}


def sentence(plant: RigPlant) -> str:
    """Each refusal says why, in a sentence."""
    found = [each.json for each in plant.messages("result/#")]
    return "" if found and all(len(each["text"]) > 10 for each in found) else str(found)


PAYLOADS = [
    row(
        f"a start with {what} is rejected with a reason and writes nothing",
        given=SSW07 + ALICE,
        at={4.0: payload(body)},
        then={
            6.0: [
                seen("result/pump/alice", times=1, phase="rejected", verb="start"),
                count("result/#", 1),
                sentence,
                frames("pump"),
                seen("audit", times=1, decision="rejected", verb="start"),
            ]
        },
    )
    for what, body in BAD_PAYLOADS.items()
]

STOPS = [
    row(
        f"a stop with {what} as its payload stops",
        given=SSW07 + ALICE,
        sim={"pump": QUICK},
        at={3.0: command("pump/alice/start"), 6.0: publish("command/pump/alice/stop", body, client="alice")},
        then={
            10.0: [
                result("stop confirmed ok"),
                frames("pump", STOP, since=6.0),
                msg("starter/pump/state", state="ready"),
            ]
        },
    )
    for what, body in STOP_PAYLOADS.items()
]

TOPICS = [
    row(
        f"a command on {topic} does nothing, and is reported",
        given=SSW07 + ALICE,
        at={
            4.0: lambda plant, topic=topic: plant.publish(
                topic, {"id": "1", "token": plant.token()}, client="alice"
            )
        },
        then={
            6.0: [
                seen("gateway/event", code="malformed_topic", severity="warning", times=1),
                results(*filter(None, (said,))),
                frames("pump"),
                seen("audit", times=1, decision="rejected"),
            ]
        },
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
    row(
        "a command to a line of results or events is none",
        given=SSW07 + ALICE,
        at={
            4.0: [
                publish("result/pump/alice", {"id": "1"}),
                publish("starter/pump/state", {"state": "running"}),
            ]
        },
        then={8.0: [frames("pump"), never("audit"), never("result/pump/alice", phase="accepted")]},
    ),
    row(
        "a message of a megabyte beside the commands changes nothing",
        given=SSW07 + ALICE,
        at={4.0: publish("command/pump/alice/start", b"x" * 1_000_000, client="alice")},
        then={
            30.0: [
                msg("starter/pump/state", quality="good"),
                msg("gateway/status", state="online"),
                frames("pump"),
            ]
        },
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
    row(
        "of 500 starts at once one starts, and every other is refused once or counted",
        given=SSW07 + ALICE,
        sim={"pump": QUICK},
        at={4.0: flood("start", 500)},
        then={
            15.0: [
                frames("pump", START),
                _one_answer_each,
                seen("result/pump/alice", code="too_many"),
                seen("result/pump/alice", code="busy"),
            ]
        },
    ),
    row(
        "a stop behind 500 starts is on the line first",
        given=SSW07 + ALICE,
        at={4.0: [flood("start", 500), command("pump/alice/stop", fresh=False)]},
        then={
            4.5: [
                lambda plant: (
                    "" if [pdu for _, pdu in plant.starter("pump").writes][-1:] == [STOP] else "no stop"
                )
            ]
        },
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
    row(
        "stops are never limited: 100 at once are carried out, with frames in moderation",
        given=SSW07 + ALICE,
        at={4.0: flood("stop", 100)},
        then={
            30.0: [
                never("result/pump/alice", phase="failed"),
                seen("result/pump/alice", code="too_many", id=None, count=...),
                lambda plant: (
                    ""
                    if 8 <= len(plant.starter("pump").writes) <= 40
                    else str(len(plant.starter("pump").writes))
                ),
                msg("starter/pump/state", state="ready", quality="good"),
                clean_line,
            ]
        },
    ),
    row(
        "a flood of mistyped topics is one event a second, with its count",
        given=SSW07 + ALICE,
        at={
            4.0: lambda plant: [
                plant.publish("command/pump/alice/START", b"x", client="alice") for _ in range(300)
            ]
        },
        then={
            10.0: [
                count("gateway/event", 6, since=4.0, at_least=1),
                seen("gateway/event", code="malformed_topic"),
            ]
        },
    ),
    row(
        "a flood costs the polls nothing",
        given=SSW07 + ALICE,
        at={4.0 + n / 10: flood(f"start{n}", 30) for n in range(40)},
        then={
            12.0: [
                msg("starter/pump/availability", state="online"),
                never("starter/pump/value/current", quality="stale"),
            ]
        },
    ),
]


@pytest.mark.parametrize("row", PAYLOADS + STOPS + TOPICS + REFUSED + FLOODS)
def test_what_arrives(row: ScenarioRow) -> None:
    play(row)


def test_random_messages_beside_the_commands_never_raise_and_start_nothing() -> None:
    """What is a bug in the log fails the test (`RigPlant`)."""
    dice = random.Random(1)
    odd: list[Any] = [
        None,
        True,
        7,
        -(10**25),
        1.5,
        "",
        "x" * 70,
        "\ud800",
        "a\x00",
        "P314",
        [],
        ["1"],
        {"value": {}},
        {"a": 1},
    ]
    keys = ["id", "token", "boot", "issued_at", "ttl_s", "operator", "reason", "args", "expect", "select"]
    verbs = ["start", "jog", "set", "read", "select", "lock", "unlock", "STOP", "x", "start/now", "", "é"]
    with RigPlant(SSW07 + ALICE) as plant:
        plant.run(until=3.0)
        for _ in range(400):
            body = json.dumps(
                {key: dice.choice(odd) for key in dice.sample(keys, dice.randrange(8))}
            ).encode()
            content = dice.choice([body, body[: dice.randrange(len(body))], dice.randbytes(20)])
            flags: dict[str, Any] = {"retain": dice.random() < 0.2, "client": "alice"}
            plant.publish(f"command/pump/alice/{dice.choice(verbs)}", content, **flags)
            plant.run(until=plant.world.now_s() + 0.2)
        plant.run(until=plant.world.now_s() + 3.0)

        assert {each.split()[-2] for each in plant.results()} == {"rejected"}
        assert plant.starter("pump").writes == []
        assert plant.last("gateway/status")["state"] == "online"
