"""How a run begins and ends, and what the next one remembers after an end and after a kill."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

from tests.rig import (
    RigPlant,
    command,
    event,
    fault,
    frames,
    msg,
    never,
    played,
    result,
    retained,
    row,
    scene,
    seen,
    that,
)
from tests.rig.sites import ALICE, FOUR, QUICK, SSW07
from tests.scenarios.broker.support import TRIP, afresh, order

START, STOP = "05 00 64 ff 00", "05 00 64 00 00"
LOCK = command("pump/alice/lock", args={"reason": "belt is off"})


def nothing_good(since: float, topic: str = "starter/+/#") -> Callable[[RigPlant], str]:
    """Nothing was called good or online from then on."""

    def check(plant: RigPlant) -> str:
        for each in plant.messages(topic, since):
            body: dict[str, Any] = each.json if each.payload else {}
            if body.get("quality") == "good" or body.get("state") == "online":
                return str(each)
        return ""

    return check


def last_words(plant: RigPlant) -> str:
    """The gateway's status is the last message of all; before it, all starters are offline and stale."""
    log = [each for each in plant.broker.log if each.client == "plant"]
    if not log[-1].topic.endswith("gateway/status") or log[-1].json["state"] != "offline":
        return str(log[-1])
    fresh = [
        topic
        for topic, each in plant.broker.retained.items()
        if each.json.get("quality") == "good" or each.json.get("state") == "online"
    ]
    return f"still fresh: {fresh}" if fresh else ""


BEGINNING = [
    scene(
        "a start says starting, publishes every retained topic, then online",
        FOUR,
        {},
        8.0,
        afresh(0.0),
        order(("gateway/status", {"state": "starting"}), ("gateway/status", {"state": "online"})),
        retained("gateway/status", state="online", reason=None, since=..., boot=..., run=...),
    ),
    scene(
        "a run begins without any good value, whatever the one before had published",
        SSW07,
        {5.0: ["kill", fault("silent", "pump")], 6.0: "start"},
        30.0,
        nothing_good(5.1),
        retained("starter/pump/availability", state="offline"),
        retained("starter/pump/state", state="unknown"),
        retained("starter/pump/value/current", quality="bad"),
    ),
]

ENDS = [
    scene(
        "an orderly end says offline and stale of every starter, then of the gateway",
        FOUR,
        {6.0: "end"},
        6.0,
        last_words,
        retained("gateway/status", state="offline", reason=...),
        retained("starter/belt/availability", state="offline", reason=re.compile("the gateway ended")),
        retained("starter/belt/state", quality="stale"),
        retained("starter/belt/value/current", quality="stale"),
        event("stopping"),
        order(
            ("gateway/event", {"code": "stopping"}),
            ("starter/belt/availability", {"state": "offline"}),
            ("gateway/status", {"state": "offline"}),
            since=5.9,
        ),
    ),
    scene(
        "a kill leaves the will: offline, with no time of its own, and nothing else changes",
        SSW07,
        {6.0: "kill"},
        9.0,
        retained("gateway/status", state="offline", time=None),
        retained("starter/pump/availability", state="online"),
        never("gateway/event", code="stopping"),
    ),
    *(
        row(
            f"an end with the {words} is over within ten seconds",
            given=SSW07,
            at={5.0: words, 6.0: "end"},
            then={6.0: that(lambda plant: plant.world.now_s() < 16.0)},
        )
        for words in ("broker down", "broker stalls")
    ),
]


def again(**fields: Any) -> Callable[[RigPlant], object]:
    return lambda plant: plant.command("pump/alice/start", id="one", **fields)


MEMORY = [
    row(
        "a start under way at a kill ends unconfirmed, crashed, in the next run, and is not repeated",
        given=SSW07 + ALICE,
        at={4.0: command("pump/alice/start", id="one"), 4.1: "kill", 6.0: "start", 12.0: again()},
        then={
            11.0: [
                result("start unconfirmed crashed"),
                seen("result/pump/alice", phase="unconfirmed", id="one", times=1),
                event("command_cut_short", topic="starter/pump/event", severity="error"),
                seen("audit", id="one", decision="unconfirmed", code="crashed", times=1),
            ],
            14.0: [msg("result/pump/alice", id="one", code="crashed", duplicate=True), frames("pump", START)],
        },
    ),
    scene(
        "a maintenance lock outlives a kill and an orderly end",
        SSW07 + ALICE,
        {4.0: LOCK, 6.0: "kill", 7.0: "start", 12.0: "restart", 18.0: command("pump/alice/start")},
        19.0,
        result("start rejected locked"),
        retained("starter/pump/state", locked={"by": "alice", "reason": "belt is off"}),
        frames("pump"),
    ),
    scene(
        "a fault that an earlier run has published is no event again, and its alarm is never cleared between",
        SSW07,
        {4.0: TRIP, 10.0: "kill", 12.0: "start"},
        25.0,
        seen("starter/pump/event", code="fault", times=1),
        that(lambda plant: len({m.json["id"] for m in plant.messages("starter/pump/trip")}), 1),
        retained("starter/pump/alarm/e05", active=True),
        that(lambda plant: all(m.payload for m in plant.messages("starter/pump/alarm/e05"))),
    ),
]


test_a_life = played(BEGINNING + ENDS + MEMORY)


def test_the_audit_is_one_chain_over_kills_and_restarts() -> None:
    with RigPlant(SSW07 + ALICE, sim={"pump": QUICK}) as plant:
        for number in range(3):
            plant.run(until=plant.world.now_s() + 5.0)
            plant.command("pump/alice/stop", id=f"stop-{number}")
            plant.run(until=plant.world.now_s() + 4.0)
            (plant.kill if number else plant.end)()
            plant.start()
        plant.run(until=40.0)

        verified = plant.cli("audit", "verify", "CONFIG")
        shown = plant.cli("audit", "show", "CONFIG")

        assert verified.code == 0, verified
        assert [shown.out.count(f"stop-{number}") >= 1 for number in range(3)] == [True] * 3
