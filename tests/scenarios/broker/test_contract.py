"""Every message of a busy day is one that docs/reference describes, on topics by the contract's rules."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cache
from itertools import pairwise

import pytest
from jsonschema import Draft7Validator

from gateway.contract import EventRecord, HistoryRecord, read_record
from tests.reference.contract_pages import TOPICS, Topic, closed
from tests.rig import RigPlant, played, result, retained, row, scene, that
from tests.rig.broker import MqttMessage
from tests.rig.sites import (
    ALICE,
    FOUR,
    HOME_ASSISTANT,
    LOGIN,
    METRICS,
    PASSWORD,
    QUICK,
    SPARKPLUG,
    SSW07,
    WEB,
    operator,
    table,
)

BASE = "starters/plant"
DAY = (
    FOUR.replace('name = "pumps"', 'name = "pumps"\ntitle = "Hall"').replace(
        'name = "pump"', 'name = "pump"\ntitle = "Pump 1"'
    )
    + ALICE
    + table("[group]", name="hall", title="Hall", starters=["pump", "fan"])
    + WEB
    + LOGIN
    + METRICS
    + HOME_ASSISTANT
    + SPARKPLUG
    + 'commands = true\noperator = "alice"\n'
)
BELT = DAY.index("[[line.starter]]", DAY.index("mill"))
WITHOUT_BELT = DAY[:BELT] + DAY[DAY.index("[[operator") :]


@pytest.fixture(scope="module")
def day() -> list[MqttMessage]:
    """Return all messages of a day: commands by every way, a trip, an outage, a reload, a kill, an end."""
    with RigPlant(DAY, sim=dict.fromkeys(("pump", "fan"), QUICK)) as plant:
        plant.run(until=5.0)
        plant.command("pump/alice/start")
        plant.run(until=9.0)
        plant.command("pump/alice/start")
        plant.command("mill/alice/read", args={"parameter": "S1.1.1"})
        plant.run(until=11.0)
        plant.do(lambda: plant.lines["pumps"].set_knob("pump", "trip", "E05"))
        plant.do(lambda: plant.lines["pumps"].silent("fan", 20.0))
        plant.run(until=15.0)
        plant.publish("spBv1.0/plant/DCMD/plant/pump", plant.sparkplug({"Command/Stop": True}))
        plant.run(until=18.0)
        plant.browser.log_in("anna", PASSWORD)
        plant.do(lambda: plant.lines["pumps"].set_knob("pump", "clear", ""))
        plant.run(until=20.0)
        plant.post("/api/v1/command/pump/read", {"id": "page", "args": {"parameter": "P003"}})
        plant.publish("command/PUMP/alice/start", b"x", client="alice")
        plant.broker.stop()
        for current in range(100, 110):
            plant.starter("pump").set_word("P003", current)
            plant.run(until=plant.world.now_s() + 1.5)
        plant.broker.start()
        plant.run(until=45.0)
        plant.reload(WITHOUT_BELT)
        plant.run(until=50.0)
        plant.kill()
        plant.start()
        plant.run(until=60.0)
        plant.end()
        return [each for each in plant.broker.log if each.topic.startswith(BASE) and each.client == "plant"]


LOOSE = {"command", "result"}  # whose fields depend on the verb
RARE = {  # what this day does not have
    "lineStatistics": {"uart_errors"},  # of a real port
    "starterValue": {"reason"},
    "starterStart": {"drift", "lowest_v", "outliers", "own"},
    "starterTrip": {"thinned"},
}


@cache
def topic_of(address: str) -> Topic:
    """Return what the reference says of a topic."""
    return next(
        each
        for each in TOPICS
        if re.fullmatch(re.sub(r"{\w+}", "[a-z0-9_-]+", each.address), address.removeprefix(f"{BASE}/"))
    )


def problems(message: MqttMessage) -> Iterator[str]:
    """Yield what is not as the reference says."""
    topic = topic_of(message.topic)
    if (message.qos, message.retain) != topic.delivery:
        yield f"{message}: delivered otherwise"
    if not message.payload:
        yield from () if "deleted" in topic.messages else (f"{message}: an empty payload",)
        return
    for error in Draft7Validator(closed(topic.schema)).iter_errors(message.json):
        yield f"{message}: {'.'.join(map(str, error.path))}: {error.message[:200]}"


def test_every_message_is_as_the_reference_says(day: list[MqttMessage]) -> None:
    assert [problem for each in day for problem in problems(each)][:5] == []
    assert {each.name for each in TOPICS} - {topic_of(each.topic).name for each in day} <= {"command"}


def test_every_field_that_the_reference_names_is_published(day: list[MqttMessage]) -> None:
    found: dict[str, set[str]] = {}
    for each in day:
        found.setdefault(topic_of(each.topic).name, set()).update(each.json if each.payload else ())

    missing = {each.name: set(each.schema["properties"]) - found.get(each.name, set()) for each in TOPICS}
    assert {name: fields for name, fields in missing.items() if fields and name not in LOOSE} == RARE


def test_a_record_is_read_as_it_was_written(day: list[MqttMessage]) -> None:
    for message in day:
        topic = topic_of(message.topic)
        if message.payload and topic.kind not in (EventRecord, HistoryRecord):
            address = re.compile(".*/" + re.sub(r"{(\w+)}", r"(?P<\1>[a-z0-9_-]+)", topic.address))
            found = address.fullmatch(message.topic)
            assert topic.kind
            assert found
            assert read_record(topic.kind, message.payload, **found.groupdict()).payload() == message.payload


def test_no_topic_that_carries_a_payload_is_a_prefix_of_another(day: list[MqttMessage]) -> None:
    topics = sorted({each.topic for each in day})

    assert [pair for pair in pairwise(topics) if pair[1].startswith(pair[0] + "/")] == []
    assert all(re.fullmatch("[a-z0-9_-]+(/[a-z0-9_-]+)*", each) for each in topics)


def test_topic_boot_and_seq_name_a_message_and_a_run_counts_up(day: list[MqttMessage]) -> None:
    named: dict[tuple[str, str, int], bytes] = {}
    newest: dict[tuple[str, str], int] = {}
    for each in day:
        body = each.json if each.payload else {}
        if "seq" not in body:
            continue
        assert named.setdefault((each.topic, body["boot"], body["seq"]), each.payload) == each.payload
        assert newest.get((each.topic, body["boot"]), 0) <= body["seq"]  # one topic never goes back
        newest[each.topic, body["boot"]] = body["seq"]
    assert len({boot for _, boot, _ in named}) == 2


def test_each_command_has_one_final_result_and_its_audit(day: list[MqttMessage]) -> None:
    results = [each.json for each in day if "/result/" in each.topic]
    finals = [each["id"] for each in results if each["phase"] not in ("accepted", "written")]
    audits = [each.json for each in day if each.topic.endswith("/audit")]

    assert len(finals) == len(set(finals)) >= 4
    assert {each["id"] for each in audits} >= set(finals)
    assert {each.get("source") for each in audits} == {None, "sparkplug", "web"}


SHAPES = [
    scene(
        "the gateway's info says what it is, what it has, who may do what, and that it is no protection",
        FOUR + ALICE + operator("bob", may=("stop",), starters=("pump",), freshness="issued_at"),
        {},
        4.0,
        retained(
            "gateway/info",
            product="starter-gateway",
            contract=1,
            starters=["pump", "fan", "mill", "belt"],
            lines=["pumps"],
            mqtt_version="5",
            notice=re.compile("safety"),
            operators=[
                {"client": "alice", "may": ["*"], "starters": ["*"], "freshness": "token"},
                {"client": "bob", "may": ["stop"], "starters": ["pump"], "freshness": "issued_at"},
            ],
            qos=1,
        ),
    ),
    row(
        "the outbox says what waits, what was lost, and how often the gateway came back",
        given=SSW07,
        at={35.0: "broker down", 36.0: "pump trip E05", 50.0: "broker up"},
        then={
            34.0: retained("gateway/outbox", oldest_s=0.0, dropped=0, refused=0, reconnects=0),
            95.0: retained("gateway/outbox", oldest_s=0.0, dropped=0, refused=0, reconnects=1),
        },
    ),
    scene(
        "a base of several levels carries everything, commands too",
        SSW07 + ALICE + table("mqtt", url="mqtt://127.0.0.1", base="acme/site1/{gateway}"),
        {4.0: lambda plant: plant.command("pump/alice/stop", fresh=False)},
        8.0,
        retained("/starters/plant/#"),
        that(lambda plant: plant.base, "acme/site1/plant"),
        retained("starter/pump/state", state="ready"),
        result("stop confirmed ok"),
    ),
]


test_the_gateways_own_topics = played(SHAPES)
