"""The broker is away, returns, stands still, or keeps its acknowledgements: nothing is lost or acts late."""

from __future__ import annotations

import itertools
import re

import pytest

from tests.rig import (
    RigPlant,
    clean_line,
    command,
    event,
    frames,
    msg,
    never,
    played,
    retained,
    row,
    scene,
    seen,
    that,
)
from tests.rig.sites import ALICE, FOUR, QUICK, SSW07
from tests.scenarios.broker.support import HEAL, TRIP, afresh, broker, codes, count, order

START, FRESH = "05 00 64 ff 00", "gateway/fresh"


def _history(plant: RigPlant) -> str:
    """Items of the outage come whole, in order, with numbers of their own and at most 200 in a message."""
    found = [each.json for each in plant.messages("starter/pump/history")]
    items = [item for each in found for item in each["items"]]
    live = {each.json["seq"] for each in plant.messages("starter/pump/value/#")}
    currents = [item["value"] for item in items if item["point"] == "current"]
    numbers = [item["seq"] for item in items]
    if not found or len({each["boot"] for each in found}) != 1:
        return f"{len(found)} messages of history"
    if numbers != sorted(set(numbers)) or live & set(numbers):
        return "an item came twice or out of order"
    if any(len(each["items"]) > 200 for each in found):
        return "a message has more than 200 items"
    return "" if currents == [11.0, 12.0] else f"currents: {currents}"  # 13.0 is live at the return


def _same_number_same_bytes(plant: RigPlant) -> str:
    seen_once: dict[tuple[str, str, int], bytes] = {}
    for each in plant.messages("starter/#"):
        body = each.json if each.payload else {}
        if (
            "seq" in body
            and seen_once.setdefault((each.topic, body["boot"], body["seq"]), each.payload) != each.payload
        ):
            return f"two messages with one number: {each}"
    return ""


def _two_runs(plant: RigPlant) -> str:
    """The fault of the run before comes before that of this one, which found it at its first reading."""
    found = [each.json for each in plant.messages("starter/pump/event", since=5.0)]
    faults = [(each["data"]["from"], each["boot"]) for each in found if each["code"] == "fault"]
    is_right = [state for state, _ in faults] == ["ready", None] and len({boot for _, boot in faults}) == 2
    return "" if is_right else str(faults)


def _one_at_a_time(plant: RigPlant) -> str:
    times = [each.at_s for each in plant.broker.log if each.qos == 1 and each.client == "plant"]
    gaps = [later - earlier for earlier, later in itertools.pairwise(times)]
    return "" if len(times) > 50 and min(gaps) > 0.0099 else f"{len(times)} messages, {min(gaps)} s apart"


OUTAGES = [
    scene(
        "faults of an outage are published at the return, once each, in order and with their own time",
        SSW07,
        {5.0: "broker down", 8.0: TRIP, 14.0: HEAL, 20.0: TRIP, 30.0: "broker up"},
        60.0,
        codes("starter/pump/event", "fault", "cleared", "fault", since=5.0),
        seen("starter/pump/event", code="fault", times=1, time=re.compile("00:00:0[89]")),
        seen("starter/pump/event", code="fault", times=1, time=re.compile("00:00:2[01]")),
        seen("starter/pump/trip", code="e05", times=2),
        retained("starter/pump/alarm/e05", active=True, count=2),
        clean_line,
    ),
    scene(
        "a value of the outage is published as it is now, and what it was meanwhile as history",
        SSW07,
        {
            4.0: "pump P003 = 100",
            8.0: "broker down",
            10.0: "pump P003 = 110",
            15.0: "pump P003 = 120",
            20.0: "pump P003 = 130",
            30.0: "broker up",
        },
        60.0,
        msg("starter/pump/value/current", value=13.0, quality="good"),
        never("starter/pump/value/current", value=11.0),
        never("starter/pump/value/current", value=12.0),
        _history,
        seen("starter/pump/history", times=0, retain=True),
    ),
    row(
        "a final result that the broker missed comes at the return, once",
        given=SSW07 + ALICE,
        sim={"pump": QUICK},
        at={3.0: command("pump/alice/start"), 3.1: "broker down", 20.0: "broker up"},
        then={
            19.0: never("result/pump/alice", phase="confirmed"),
            40.0: [
                seen("result/pump/alice", phase="confirmed", code="ok", times=1),
                frames("pump", START),
                seen("audit", verb="start", decision="confirmed", times=1),
            ],
        },
    ),
    scene(
        "each return publishes every retained topic before online",
        FOUR,
        {8.0: "broker down", 12.0: "broker up"},
        30.0,
        afresh(12.0),
        order(("starter/belt/state", {}), ("gateway/status", {"state": "online"}), since=12.0),
        never("gateway/status", since=12.0, state="offline"),
    ),
    scene(
        "an outage is reported at its end, with both its causes, and each connection has a boot of its own",
        SSW07,
        {5.0: "broker down", 15.0: "broker up"},
        25.0,
        codes("gateway/event", "broker_away", "broker_away", "broker_connected", since=10.0),
        that(lambda plant: len({m.json["boot"] for m in plant.messages("gateway/status")}), 2),
    ),
    row(
        "what waits for the broker outlives a kill and goes out first, with the run that it had",
        given=SSW07,
        at={5.0: "broker down", 8.0: TRIP, 10.5: "kill", 13.0: "start", 20.0: "broker up"},
        then={50.0: [_two_runs, _same_number_same_bytes]},
    ),
]

ACKNOWLEDGEMENTS = [
    scene(
        "what was not acknowledged is sent again, the same to the byte",
        SSW07,
        {4.0: broker(ack_after_s=None), 5.0: TRIP, 12.0: broker(ack_after_s=0.0)},
        60.0,
        seen("starter/pump/event", code="fault"),
        event("broker_away"),
        _same_number_same_bytes,
        msg("gateway/status", state="online"),
    ),
    row(
        "a broker that takes one message at a time gets one at a time, and all of them",
        given=SSW07,
        before=broker(connack={"ReceiveMaximum": 1}, ack_after_s=0.01),
        at={10.0: TRIP},
        then={
            30.0: [
                _one_at_a_time,
                msg("gateway/status", state="online"),
                codes("starter/pump/event", "fault"),
                msg("starter/pump/state", state="fault"),
            ]
        },
    ),
]


test_nothing_is_lost = played(OUTAGES + ACKNOWLEDGEMENTS)


@pytest.mark.parametrize(
    ("stall_s", "expected"),
    [
        (3.0, [START]),
        (5.5, []),
        (60.0, []),
    ],
)
def test_a_start_that_a_stalled_broker_held_acts_within_its_time_or_never(
    stall_s: float, expected: list[str]
) -> None:
    with RigPlant(SSW07 + ALICE, sim={"pump": QUICK}) as plant:
        plant.run(until=5.0)
        token = plant.token()
        plant.broker.stall()
        plant.command("pump/alice/start", token=token)
        plant.run(until=5.0 + stall_s)
        plant.broker.stall(is_stalled=False)
        plant.run(until=5.0 + stall_s + 15.0)
        held = [pdu for _, pdu in plant.starter("pump").writes]

        plant.command("pump/alice/start", token=token)
        plant.run(until=plant.world.now_s() + 1.0)
        by_the_old_token = plant.results()[-1]
        plant.command("pump/alice/stop")
        plant.run(until=plant.world.now_s() + 5.0)
        plant.command("pump/alice/start")
        plant.run(until=plant.world.now_s() + 5.0)

        assert held == expected
        assert by_the_old_token in ("start rejected not_fresh", "start rejected expired")
        assert plant.results()[-1] == "start confirmed ok"  # a token of this connection


STALLS = [
    row(
        "a stop that a stalled broker held stops when it comes",
        given=SSW07 + ALICE,
        at={5.0: "broker stalls", 5.1: command("pump/alice/stop", fresh=False), 9.0: "broker goes"},
        then={8.9: frames("pump"), 9.5: that(lambda plant: bool(plant.starter("pump").writes))},
    ),
    scene(
        "a half-open connection is given up, and a new one has new tokens",
        SSW07,
        {5.0: "broker stalls", 40.0: "broker goes"},
        60.0,
        event("broker_away"),
        afresh(40.0),
        count(FRESH, 25, since=40.0, at_least=15),
        that(lambda p: len({m.json["token"] for m in p.messages(FRESH)}) == len(p.messages(FRESH))),
    ),
]


test_stalls_and_half_open_connections = played(STALLS)
