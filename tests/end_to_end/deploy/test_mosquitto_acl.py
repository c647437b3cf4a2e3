"""The access list that we ship, in a real Mosquitto."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.mosquitto import READY, MosquittoBroker, StartMosquitto

DEPLOY = Path(__file__).parents[3] / "deploy" / "mosquitto"
USERS = {name: f"{name}-password" for name in ("mcc1", "alice", "bob", "viewer", "auditor")}
BASE = "starters/mcc1"

GATEWAYS_OWN = (
    f"{BASE}/gateway/status",
    f"{BASE}/gateway/line/pumps",
    f"{BASE}/starter/pump-1/state",
    f"{BASE}/starter/pump-1/value/current",
    f"{BASE}/result/pump-1/alice",
    f"{BASE}/audit",
)


@pytest.fixture
def broker(start_mosquitto: StartMosquitto) -> MosquittoBroker:
    acl = (DEPLOY / "acl").read_text("utf-8")
    # What the tests' watcher needs for itself.
    acl += "".join(f"user {name}\ntopic readwrite {READY}\n" for name in USERS)
    started = start_mosquitto(users=USERS, acl=acl)
    assert isinstance(started, MosquittoBroker)
    return started


def may_write(broker: MosquittoBroker, user: str, topic: str) -> bool:
    """Return whether the broker takes a message; mosquitto_pub ends well either way, so its log is read."""
    broker.publish(topic, "x", user=(user, USERS[user]))
    verdicts = re.findall(rf"(Received|Denied) PUBLISH from .* '{re.escape(topic)}'", broker.log())
    return bool(verdicts[-1] == "Received")


def test_a_user_writes_commands_only_under_his_own_name(broker: MosquittoBroker) -> None:
    assert may_write(broker, "alice", f"{BASE}/command/pump-1/alice/start")
    assert may_write(broker, "bob", f"{BASE}/command/pump-1/bob/stop")
    assert not may_write(broker, "alice", f"{BASE}/command/pump-1/bob/start")
    assert not may_write(broker, "alice", f"{BASE}/command/alice/bob/alice")


@pytest.mark.parametrize("user", ["viewer", "auditor", "mcc1"])
def test_who_is_no_operator_writes_no_command_not_even_under_his_own_name(
    broker: MosquittoBroker, user: str
) -> None:
    for client in (user, "alice"):
        assert not may_write(broker, user, f"{BASE}/command/pump-1/{client}/start")


def test_only_the_gateway_writes_what_the_gateway_says(broker: MosquittoBroker) -> None:
    assert all(may_write(broker, "mcc1", topic) for topic in GATEWAYS_OWN)
    for user in ("alice", "bob", "viewer", "auditor"):
        assert not any(may_write(broker, user, topic) for topic in GATEWAYS_OWN)


@pytest.mark.parametrize(
    ("user", "read"),
    [
        ("alice", {"state", "status", "alice"}),
        ("bob", {"state", "status"}),
        ("viewer", {"state", "status"}),
        ("auditor", {"audit"}),
    ],
)
async def test_everybody_reads_what_is_meant_for_him(
    broker: MosquittoBroker, user: str, read: set[str]
) -> None:
    last_levels = {
        topic.rpartition("/")[2]: topic
        for topic in GATEWAYS_OWN
        if "line" not in topic and "value" not in topic
    }
    for topic in last_levels.values():
        broker.publish(topic, "x", "-r", user=("mcc1", USERS["mcc1"]))

    async with broker.watch("#", user=(user, USERS[user])) as watcher:
        seen = {(await watcher.next()).topic for _ in read}
        assert seen == {last_levels[level] for level in read}
        assert not watcher._early


async def test_the_gateway_reads_everybodys_commands(broker: MosquittoBroker) -> None:
    async with broker.watch(f"{BASE}/command/+/+/+", user=("mcc1", USERS["mcc1"])) as gateway:
        for user in ("alice", "bob"):
            broker.publish(f"{BASE}/command/pump-1/{user}/stop", "", user=(user, USERS[user]))

        seen = [(await gateway.next()).topic for _ in range(2)]

    assert seen == [f"{BASE}/command/pump-1/alice/stop", f"{BASE}/command/pump-1/bob/stop"]
