"""The connection against a real Mosquitto, in real time."""

from __future__ import annotations

import gc
import json
from collections.abc import Callable
from pathlib import Path

import pytest
from paho.mqtt import client as paho

from gateway.mqtt.connection.reconnect import Version
from gateway.mqtt.connection.session import Session
from gateway.mqtt.connection.settings import TlsSettings
from tests.mosquitto import Certificate, Seen, StartMosquitto
from tests.mqtt.rig import MqttRig, event, settings

BOTH = pytest.mark.parametrize("version", list(Version))
STATUS = "b/gateway/status"


def is_status(state: str) -> Callable[[Seen], bool]:
    return lambda seen: seen.topic == STATUS and bool(json.loads(seen.payload)["state"] == state)


def seqs(messages: list[Seen]) -> list[int]:
    return [json.loads(seen.payload)["seq"] for seen in messages if seen.topic.endswith("/event")]


@BOTH
async def test_a_wrong_password_is_reported_once_with_its_hint(
    start_mosquitto: StartMosquitto, version: Version
) -> None:
    broker = start_mosquitto(users={"mcc1": "right"})
    async with MqttRig(settings(broker.port, username="mcc1", password="wrong", version=version)) as rig:
        is_connected, trouble = await rig.link()
        while broker.log().count("New connection") < 4:
            await rig.connection._pause(0.05)

    assert not is_connected
    assert trouble.startswith(f"broker 127.0.0.1:{broker.port} refuses the connection: Not authorized (")
    assert rig.links.empty()


async def test_a_tls_connection_is_checked_against_its_authority(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    certificate = Certificate.make(tmp_path)
    broker = start_mosquitto(tls=certificate)
    how = settings(broker.port, host="localhost", tls=TlsSettings(ca_file=str(certificate.cert)))
    async with broker.watch("b/#") as watcher, MqttRig(how) as rig:
        await rig.until_connected()
        payload = "x" * 4000
        for _ in range(3):
            broker.publish("b/command/pump-1/alice/stop", payload)
        received = [await rig.command() for _ in range(3)]
        messages = await watcher.until(is_status("starting"))

    assert [len(incoming.payload) for incoming in received] == [4000] * 3
    assert messages


async def test_a_broker_with_a_foreign_certificate_gets_no_password(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    broker = start_mosquitto(tls=Certificate.make(tmp_path))
    how = settings(broker.port, host="localhost", tls=TlsSettings(), username="mcc1", password="secret")

    async with MqttRig(how) as rig:
        is_connected, trouble = await rig.link()

    assert not is_connected
    assert trouble.startswith(f"broker localhost:{broker.port}: its certificate: self")
    assert trouble.endswith("(check ca_file)")
    assert "CONNECT" not in broker.log()


@BOTH
async def test_the_broker_says_offline_for_a_gateway_that_vanished(
    start_mosquitto: StartMosquitto, version: Version
) -> None:
    broker = start_mosquitto()
    rig = MqttRig(settings(broker.port, version=version))
    async with broker.watch("b/#") as watcher, rig:
        rig.publisher.set_status("online")
        await watcher.until(is_status("online"))
        await rig.vanish()
        messages = await watcher.until(is_status("offline"))

    assert json.loads(messages[-1].payload) == {
        "state": "offline",
        "time": None,
        "boot": "boot-1",
        "since": None,
        "reason": "connection lost",
        "run": "boot-1",
    }


@BOTH
async def test_an_orderly_end_sends_what_waits_and_then_its_own_offline(
    start_mosquitto: StartMosquitto, version: Version
) -> None:
    broker = start_mosquitto()
    rig = MqttRig(settings(broker.port, version=version))
    async with broker.watch("b/#") as watcher, rig:
        rig.publisher.set_status("online")
        await watcher.until(is_status("online"))
        for seq in range(1, 101):
            rig.publisher.put(event(seq))
        await rig.connection.close(rig.publisher.farewell("stopped"))
        assert rig.task is not None
        await rig.task
        broker.publish("b/end", "x")
        messages = await watcher.until(lambda seen: seen.topic == "b/end")

    assert seqs(messages) == list(range(1, 101))
    statuses = [json.loads(seen.payload) for seen in messages if seen.topic == STATUS]
    assert [(status["state"], status["reason"]) for status in statuses] == [("offline", "stopped")]
    assert statuses[0]["time"] is not None


async def test_connections_that_are_lost_or_fail_leave_nothing_to_the_garbage_collection(
    start_mosquitto: StartMosquitto,
) -> None:
    broker = start_mosquitto()
    gc.collect()
    gc.disable()
    try:
        async with MqttRig(settings(broker.port)) as rig:
            await rig.until_connected()
            for _ in range(3):
                broker.kill()
                while "nothing listens" not in (await rig.link())[1]:
                    pass
                broker.start()
                await rig.until_connected()
            alive = [each for each in gc.get_objects() if isinstance(each, Session | paho.Client)]
    finally:
        gc.enable()

    assert len(alive) == 2  # the present one
