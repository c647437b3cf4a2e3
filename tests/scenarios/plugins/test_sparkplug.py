"""The gateway as a Sparkplug edge node: what docs/sparkplug.md promises, as a host sees it."""

from __future__ import annotations

import re
from typing import Any

from tests.rig import (
    RigPlant,
    apart,
    command,
    event,
    fault,
    frames,
    msg,
    never,
    played,
    publish,
    reload,
    result,
    results,
    row,
    scene,
    seen,
    that,
)
from tests.rig.rows import Expectation
from tests.rig.sites import ALICE, FOUR, QUICK, SPARKPLUG, SSW07, operator, starter
from tests.rig.state import with_document
from tests.scenarios.plugins.doors import born, write

NODE = SSW07 + SPARKPLUG
TAKES = 'commands = true\noperator = "alice"\n'
COMMANDED = SSW07 + ALICE + SPARKPLUG + TAKES
HOSTED = SSW07 + ALICE + SPARKPLUG + 'primary_host = "scada"\n'
START, STOP, RESET = {"Command/Start": True}, {"Command/Stop": True}, {"Command/Reset": True}
ON, OFF = "05 00 64 ff 00", "05 00 64 00 00"
ALL = "spBv1.0/#"


def of(kind: str, device: str = "", **metrics: Any) -> Expectation:
    """The newest message of this kind that has all these metrics has these values; `__` stands for `/`."""
    wanted = {name.replace("__", "/"): value for name, value in metrics.items()}

    def check(plant: RigPlant) -> str:
        found = [each.json["metrics"] for each in plant.messages(born(kind, device))]
        having = [each for each in found if wanted.keys() <= each.keys()]
        newest = {name: having[-1][name] for name in wanted} if having else None
        return "" if newest == wanted else f"{kind} {device}: {newest}, not {wanted}; of {len(found)}"

    return check


def numbered(plant: RigPlant) -> str:
    """Every message but a death has the next number, from 0 at each birth of the node, up to 255."""
    expected = None
    for each in plant.messages(ALL):
        kind = each.topic.split("/")[2]
        if kind not in ("NBIRTH", "NDATA", "DBIRTH", "DDATA", "DDEATH"):
            continue
        expected = 0 if kind == "NBIRTH" or expected is None else (expected + 1) % 256
        if each.json["seq"] != expected:
            return f"{each.topic} has {each.json['seq']}, not {expected}"
    return "" if expected is not None else "nothing was published"


def bd_seqs(kind: str, *expected: int) -> Expectation:
    """Births, or deaths, with these numbers.

    After an orderly end with MQTT 5 the server publishes the will as well.
    """

    def check(plant: RigPlant) -> str:
        found = [each.json["metrics"]["bdSeq"] for each in plant.messages(born(kind))]
        if kind == "NDEATH":
            found = sorted(set(found))
        return "" if found == list(expected) else f"{kind}: {found}"

    return check


def offered(*verbs: str) -> Expectation:
    """The newest birth of the pump offers these commands, none of which is given."""

    def found(plant: RigPlant) -> list[tuple[str, object]]:
        metrics = plant.messages(born("DBIRTH", "pump"))[-1].json["metrics"]
        return sorted(each for each in metrics.items() if re.match("Command/(?!Last)", each[0]))

    return that(found, [(f"Command/{verb}", False) for verb in verbs])


def host(state: bool, server: str = "") -> Any:
    """Let the primary host say at a server that it is online, or that it is not."""

    def act(plant: RigPlant) -> None:
        said = {"online": state, "timestamp": round(plant.world.utc_s() * 1000)}
        broker = plant.other_broker(server) if server else plant.broker
        broker.client("scada").publish("spBv1.0/STATE/scada", said, retain=True)

    return act


BIRTHS = [
    scene(
        "a birth of a node and of a device has every point and who it is",
        NODE,
        {},
        5.0,
        event("sparkplug_born"),
        of("NBIRTH", Properties__Software="starter-gateway", broker__connected=True),
        msg(
            born("DBIRTH", "pump"),
            metrics={
                "Properties/Hardware Make": "WEG",
                "Properties/Family": "ssw07",
                "Properties/Line": "pumps",
                "Properties/Address": 1,
                "availability": "online",
                "current": ...,
                "p006": ...,
                "hours_total": ...,
                "alarm/active": False,
                "locked": False,
            },
        ),
        of("DDATA", "pump", Properties__FW="1.40"),
        of("DDATA", "pump", state="ready", remote=True),
        of("DDATA", "pump", current=0.0),
    ),
    scene(
        "without commands none is offered, and none is taken",
        SSW07 + ALICE + SPARKPLUG,
        {4.0: write(STOP)},
        6.0,
        offered(),
        results(),
        frames("pump"),
    ),
    scene(
        "a starter that has never answered is not born",
        FOUR + SPARKPLUG,
        {},
        30.0,
        never(born("DBIRTH", "fan")),
        never(born("DDEATH", "fan")),
        seen(born("DBIRTH", "mill")),
        absent=("fan",),
    ),
    row(
        "changes are published at most four times a second, an alarm with its code",
        given=SSW07 + SPARKPLUG,
        at={5.0: "pump P003 = 1234", 15.0: "pump trip E05"},
        then={
            10.0: of("DDATA", "pump", current=123.4),
            20.0: [
                of("DDATA", "pump", fault=True, state="fault"),
                of("DDATA", "pump", alarm__active=True, alarm__code="e05", alarm__severity="fault"),
                apart(born("DDATA", "pump"), 0.241),
            ],
        },
    ),
]

DEATHS = [
    row(
        "a starter that falls silent dies, and is born again when it answers",
        given=NODE,
        at={5.0: fault("silent", "pump", for_s=20.0)},
        then={
            20.0: seen(born("DDEATH", "pump"), times=1),
            60.0: [seen(born("DBIRTH", "pump"), times=2), seen(born("DDEATH", "pump"), times=1), numbered],
        },
    ),
    row(
        "a starter that leaves the configuration dies, one that comes is born",
        given=NODE,
        at={5.0: reload(SSW07 + starter("fan", 2, "ssw06") + SPARKPLUG), 10.0: reload(NODE)},
        then={
            9.0: [seen(born("DBIRTH", "fan")), never(born("DDEATH", "pump")), numbered],
            14.0: [seen(born("DDEATH", "fan"), times=1), never(born("DDEATH", "pump")), numbered],
        },
    ),
    row(
        "an orderly end publishes the death with the number of its birth",
        given=NODE,
        at={5.0: "end"},
        then={5.1: [bd_seqs("NBIRTH", 0), bd_seqs("NDEATH", 0)]},
    ),
    row(
        "a lost connection leaves the will, and the next has the next number",
        given=NODE,
        at={5.0: "broker drops", 20.0: "restart", 30.0: "kill", 31.0: "start"},
        then={
            19.0: [bd_seqs("NDEATH", 0), bd_seqs("NBIRTH", 0, 1), numbered],
            29.0: [bd_seqs("NDEATH", 0, 1), bd_seqs("NBIRTH", 0, 1, 2)],
            40.0: [bd_seqs("NDEATH", 0, 1, 2), bd_seqs("NBIRTH", 0, 1, 2, 3)],
        },
    ),
    scene(
        "after an outage the node is born with the newest values, and nothing of the time between is sent",
        NODE,
        {5.0: "broker down", 6.0: "pump P003 = 1111", 15.0: "pump P003 = 2222", 30.0: "broker up"},
        60.0,
        of("DBIRTH", "pump", current=222.2),
        never(ALL, metrics={"current": 111.1}),
        numbered,
    ),
    row(
        "switched off by a reload the node dies, and under another name, with which a new one is born",
        given=NODE,
        at={5.0: reload(SSW07), 10.0: reload(NODE), 15.0: reload(NODE + 'node = "other"\n')},
        then={
            9.0: bd_seqs("NDEATH", 0),
            14.0: bd_seqs("NBIRTH", 0, 1),
            19.0: [bd_seqs("NDEATH", 0, 1), seen("spBv1.0/plant/NBIRTH/other", times=1)],
        },
    ),
]

OWN = SSW07 + SPARKPLUG + 'urls = ["mqtt://10.0.0.2", "mqtt://10.0.0.3"]\nallow_plaintext = true\n'
WITH_HOST = OWN + 'primary_host = "scada"\n'


def born_at(*births: int) -> Expectation:
    """The servers 10.0.0.2 and 10.0.0.3 have had so many births."""

    def check(plant: RigPlant) -> str:
        found = tuple(
            sum("/NBIRTH/" in each.topic for each in plant.other_broker(name).log)
            for name in ("10.0.0.2", "10.0.0.3")
        )
        return "" if found == births else str(found)

    return check


SERVERS = [
    row(
        "the number of each connection is stored before it, and 255 is followed by 0",
        given=NODE,
        at={
            1.0: "end",
            2.0: [with_document("births", "253"), "start"],
            5.0: "broker drops",
            20.0: "broker drops",
        },
        then={40.0: bd_seqs("NBIRTH", 0, 254, 255, 0)},
    ),
    row(
        "a damaged number begins again at 0 and stops nothing",
        given=NODE,
        before=with_document("births", "no number"),
        then={5.0: [bd_seqs("NBIRTH", 0), seen(born("DBIRTH", "pump"))]},
    ),
    row(
        "the first server that is there gets the births, after its end the next",
        given=OWN,
        before=lambda plant: (plant.other_broker("10.0.0.3"), plant.other_broker("10.0.0.2").stop()),
        at={
            30.0: lambda plant: plant.other_broker("10.0.0.3").stop(),
            31.0: lambda plant: plant.other_broker("10.0.0.2").start(),
        },
        then={25.0: [born_at(0, 1), never(ALL)], 60.0: born_at(1, 1)},
    ),
    row(
        "of several servers the one with the primary host is found",
        given=WITH_HOST,
        before=lambda plant: (plant.other_broker("10.0.0.2"), host(True, "10.0.0.3")(plant)),
        at={40.0: [host(False, "10.0.0.3"), host(True, "10.0.0.2")]},
        then={39.0: born_at(0, 1), 70.0: born_at(1, 1)},
    ),
    *(
        row(
            f"a server that refuses to let it read {topic} is reported, and nothing is born",
            given=COMMANDED + 'primary_host = "scada"\n',
            before=lambda plant, topic=topic: plant.broker.deny("*-spb", topic, "read"),
            at={1.0: host(True)},
            then={20.0: [never(born("NBIRTH")), event("sparkplug_away", text=re.compile(re.escape(topic)))]},
        )
        for topic in ("spBv1.0/plant/NCMD/plant", "spBv1.0/plant/DCMD/plant/+", "spBv1.0/STATE/scada")
    ),
    row(
        "a birth that is too large for the server is reported",
        given=OWN,
        before=lambda plant: [
            plant.other_broker(name).connack.update(MaximumPacketSize=200)
            for name in ("10.0.0.2", "10.0.0.3")
        ],
        then={10.0: [born_at(0, 0), event("sparkplug_away", text=re.compile("large|bytes|packet"))]},
    ),
    row(
        "a server that takes nothing for a while gets the newest values then",
        given=NODE,
        at={5.0: "broker stalls", 6.0: "pump P003 = 1111", 8.0: "pump P003 = 2222", 12.0: "broker goes"},
        then={30.0: [numbered, seen(born("+", "pump"), metrics={"current": 222.2})]},
    ),
    row(
        "everything is subscribed to before the birth, which is the first message, with a will of QoS 1",
        given=COMMANDED,
        before=lambda plant: note_first(plant),
        then={
            5.0: that(
                lambda plant: plant.first,
                [
                    {"spBv1.0/plant/NCMD/plant", "spBv1.0/plant/DCMD/plant/+"},
                    "NBIRTH",
                    ("NDEATH", 1, False, 0),
                ],
            )
        },
    ),
]


def note_first(plant: RigPlant) -> None:
    """Keep what the node had subscribed to, and its will, when its first message came."""
    publish_it, plant.first = plant.broker.publish, []  # type: ignore[attr-defined]

    def publish_and_note(message: Any) -> int:
        if message.client.endswith("-spb") and not plant.first:  # type: ignore[attr-defined]
            (node,) = [each for each in plant.broker.connections if each.name == message.client]
            will = node.will
            assert will is not None
            plant.first += [  # type: ignore[attr-defined]
                set(node.subscriptions),
                message.topic.split("/")[2],
                (will.topic.split("/")[2], will.qos, will.retain, will.json["metrics"]["bdSeq"]),
            ]
        return publish_it(message)

    plant.broker.publish = publish_and_note  # type: ignore[method-assign]


REBIRTH = [
    scene(
        "a rebirth that is asked for comes at once, of all that answers, with the same number",
        FOUR + SPARKPLUG,
        {8.0: write({"Node Control/Rebirth": True}, device="")},
        8.5,
        bd_seqs("NBIRTH", 0, 0),
        *(seen(born("DBIRTH", name), times=2) for name in ("pump", "fan", "mill", "belt")),
        numbered,
    ),
    row(
        "many rebirths at once are two",
        given=NODE,
        at={8.0: [write({"Node Control/Rebirth": True}, device="")] * 5},
        then={12.9: bd_seqs("NBIRTH", 0, 0), 14.0: bd_seqs("NBIRTH", 0, 0, 0)},
    ),
    row(
        "a false one, a text, another metric and garbage are no rebirth",
        given=NODE,
        at={
            8.0: [
                write({"Node Control/Rebirth": False}, device=""),
                write({"Node Control/Rebirth": "true"}, device=""),
                write({"bdSeq": True}, device=""),
                publish(born("NCMD"), b"\xff\xff\xff"),
            ]
        },
        then={20.0: bd_seqs("NBIRTH", 0)},
    ),
]

PRIMARY = [
    row(
        "without its primary host nothing is published",
        given=HOSTED,
        at={20.0: host(True), 30.0: host(False), 40.0: host(True)},
        then={
            19.0: [never(born("NBIRTH")), event("sparkplug_away")],
            29.0: [bd_seqs("NBIRTH", 0), seen(born("DBIRTH", "pump"))],
            39.0: [bd_seqs("NDEATH", 0), never(born("DDATA", "pump"), since=30.5)],
            60.0: [bd_seqs("NBIRTH", 0, 1), numbered],
        },
    ),
]

WRITES = [
    row(
        "a host starts, stops and resets within the operator's rights, and sees the results",
        given=COMMANDED,
        sim={"pump": QUICK},
        at={
            5.0: write(START),
            10.0: write(STOP),
            15.0: "pump trip E05",
            20.0: write(RESET),
        },
        then={
            4.9: offered("Reset", "Start", "Stop"),
            9.0: [
                result("start confirmed ok"),
                frames("pump", ON),
                of("DDATA", "pump", Command__Start=False),
                seen(born("DDATA", "pump"), metrics={"Command/Last/Phase": "confirmed"}),
                msg("audit", source="sparkplug", client="alice", verb="start"),
            ],
            14.0: [result("stop confirmed ok"), frames("pump", ON, OFF)],
            24.0: result("reset confirmed ok"),
        },
    ),
    scene(
        "a birth offers what the operator may, and no more is taken",
        SSW07 + operator("alice", ("stop",)) + SPARKPLUG + TAKES,
        {5.0: write(START)},
        8.0,
        offered("Stop"),
        frames("pump"),
        never("result/pump/alice", phase="accepted"),
    ),
    *(
        row(
            f"a start {what} is refused: {code}",
            given=COMMANDED,
            at={**(before or {}), 18.0: wrote},
            then={21.0: [result(f"start rejected {code}"), frames("pump", *((OFF,) if before else ()))]},
        )
        for what, wrote, code, before in (
            ("of ten seconds ago", write(START, age_s=10.0), "expired", None),
            ("whose own time is older than its payload's", write(START, metric_age_s=6.5), "expired", None),
            ("of before the birth", write(START, age_s=20.0), "before_connection", None),
            ("of a moment after a stop", write(START), "stopped_first", {17.0: command("pump/alice/stop")}),
            ("that is retained", write(START, retain=True), "retained", None),
        )
    ),
    row(
        "a stop that is not retained needs neither time nor order and wins over a start beside it",
        given=COMMANDED,
        at={
            4.0: write(STOP, retain=True),
            5.0: write(STOP, age_s=3600.0),
            8.0: write({**START, **STOP}),
            14.0: write({**STOP, **START}),
        },
        then={
            4.9: frames("pump"),
            7.0: [result("stop confirmed ok"), frames("pump", OFF)],
            12.0: [
                frames("pump", OFF, OFF),
                seen("result/pump/alice", times=1, verb="start", phase="rejected", code="bad_payload"),
            ],
            18.0: [
                frames("pump", OFF, OFF, OFF),
                seen("result/pump/alice", times=2, verb="start", phase="rejected", code="bad_payload"),
            ],
        },
    ),
    row(
        "the same write again acts once",
        given=COMMANDED,
        sim={"pump": QUICK},
        at={5.0: lambda plant: twice(plant)},
        then={9.0: [frames("pump", ON), msg("result/pump/alice", duplicate=True)]},
    ),
    *(
        scene(
            f"of a payload that is {what} nothing acts, and that is said: {code}",
            COMMANDED,
            {
                5.0: lambda plant, before=before, after=after: plant.publish(
                    born("DCMD", "pump"), plant.sparkplug({**before, **STOP}) + after, client="host"
                )
            },
            8.0,
            frames("pump"),
            event("dcmd_refused", data={"starter": "pump", "code": code}),
            of("DDATA", "pump", Command__Last__Code=code),
        )
        for what, code, before, after in (
            ("garbled", "bad_payload", {}, b"\x12\xff"),
            ("too large", "too_big", {"x": "y" * 5000}, b""),
        )
    ),
    scene(
        "a write to a device that is no starter is an event, once a second",
        COMMANDED,
        {5.0: [write(STOP, device="absent")] * 3},
        8.0,
        seen(
            "gateway/event",
            times=2,
            code="dcmd_refused",
            data={"starter": "absent", "code": "unknown_starter"},
        ),
        event("dcmd_refused", data={"count": 2}),
        results(),
    ),
    row(
        "of a flood the stops act and the rest is refused",
        given=COMMANDED,
        at={5.0: [*[write(RESET)] * 120, write(STOP)]},
        then={9.0: [event("dcmd_refused", data={"code": "too_many"}), frames("pump", OFF)]},
    ),
]


def twice(plant: RigPlant) -> None:
    payload = plant.sparkplug(START)
    for _ in range(2):
        plant.publish(born("DCMD", "pump"), payload, client="host")
        plant.run(until=plant.world.now_s() + 2.0)


test_the_node = played(BIRTHS + DEATHS + SERVERS + REBIRTH + PRIMARY)
test_a_hosts_writes = played(WRITES)
