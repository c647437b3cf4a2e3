"""What clients send wrong: topics, payloads, keys, types, sizes, too much; and the audit."""

from __future__ import annotations

import pytest

from tests.rig import (
    RigPlant,
    ScenarioRow,
    command,
    event,
    frames,
    msg,
    play,
    publish,
    result,
    results,
    row,
    seen,
)
from tests.rig.sites import ALICE, LOGIN, PASSWORD, QUICK, SPARKPLUG, SSW07, WEB

SITE = SSW07 + ALICE


ARGUMENTS = [
    row(
        f"{verb} with {args}",
        given=SITE,
        at={3.0: command(f"pump/alice/{verb}", args=args)},
        then={4.0: [result(f"{verb} rejected {code}"), frames("pump")]},
    )
    for verb, args, code in (
        ("start", {"value": True}, "bad_arguments"),
        ("jog", {}, "bad_arguments"),
        ("jog", {"value": "perhaps"}, "bad_arguments"),
        ("direction", {"value": "sideways"}, "bad_arguments"),
        ("set", {"parameter": "P314"}, "bad_arguments"),
        ("set", {"parameter": "P314", "value": 3, "quickly": True}, "bad_arguments"),
        ("read", {}, "bad_arguments"),
        ("output", {"output": "RL9", "value": True}, "bad_arguments"),
    )
]

TOPICS = [
    row(
        f"a message on command/{path}: {said}",
        given=SITE,
        at={3.0: publish(f"command/{path}", "{}")},
        then={
            5.0: [
                results(*([f"{said}"] if said else [])),
                frames("pump"),
                event("malformed_topic", data={"count": 1}),
                seen("audit", decision="rejected"),
            ]
        },
    )
    for path, said in (
        ("pump/alice/STOP", "STOP rejected malformed_topic"),
        ("pump/alice/stop/", "stop/ rejected malformed_topic"),
        ("PUMP/alice/stop", "stop rejected malformed_topic"),
        ("pump/alice/fly", "fly rejected unknown_verb"),
        ("pump/alice/configure", "configure rejected unknown_verb"),
        ("pump/stop", ""),
        ("pump//stop", ""),
        ("/alice/stop", ""),
    )
]

OTHERS = [
    row(
        "a live stop with the retain flag stops, the copy that the broker keeps does not",
        given=SITE,
        at={3.0: publish("command/pump/alice/stop", '{"id": "1"}', retain=True), 6.0: "broker drops"},
        then={12.0: [result("stop confirmed ok"), frames("pump", "05 00 64 00 00")]},
    ),
]


AUDIT = [
    row(
        "the audit has each decision, with who claims to have decided, and what was read before and after",
        given=SITE,
        sim={"pump": QUICK},
        at={3.0: command("pump/alice/start", operator="Alice A.", reason="shift 2", id="one")},
        then={
            6.0: [
                seen("audit", decision="accepted", times=1),
                msg(
                    "audit",
                    starter="pump",
                    client="alice",
                    verb="start",
                    id="one",
                    decision="confirmed",
                    code="ok",
                    operator="Alice A.",
                    reason="shift 2",
                    before={"running": False},
                    after={"running": True},
                ),
            ]
        },
    ),
    row(
        "what a Sparkplug host commands comes under the same rights, and the audit names the way",
        given=SITE + SPARKPLUG + 'commands = true\noperator = "alice"\n',
        at={
            5.0: lambda plant: plant.publish(
                "spBv1.0/plant/DCMD/plant/pump", plant.sparkplug({"Command/Stop": True})
            )
        },
        then={8.0: msg("audit", verb="stop", client="alice", decision="confirmed", source="sparkplug")},
    ),
]


@pytest.mark.parametrize("row", ARGUMENTS + TOPICS + OTHERS + AUDIT)
def test_what_comes_of_a_payload_and_its_topic(row: ScenarioRow) -> None:
    play(row)


def test_a_command_of_the_page_is_in_the_audit_with_its_way_and_who_logged_in() -> None:
    with RigPlant(SITE + WEB + LOGIN, sim={"pump": QUICK}) as plant:
        plant.run(until=5.0)
        plant.browser.log_in("anna", PASSWORD)
        plant.post("/api/v1/command/pump/stop", {})
        plant.run(until=7.0)

        stored = plant.cli("audit", "verify", "CONFIG")
        noted = plant.last("audit")

    assert (noted["source"], noted["client"], noted["operator"], noted["verb"]) == (
        "web",
        "alice",
        "anna",
        "stop",
    )
    assert stored.code == 0
