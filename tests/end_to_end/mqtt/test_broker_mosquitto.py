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
from tests.mqtt.rig import MqttRig, event, settings, value

BOTH = pytest.mark.parametrize("version", list(Version))
STATUS = "b/gateway/status"


def is_status(state: str) -> Callable[[Seen], bool]:
    return lambda seen: seen.topic == STATUS and bool(json.loads(seen.payload)["state"] == state)


def seqs(messages: list[Seen]) -> list[int]:
    return [json.loads(seen.payload)["seq"] for seen in messages if seen.topic.endswith("/event")]


@BOTH
async def test_every_retained_topic_is_published_before_the_status(
    start_mosquitto: StartMosquitto, version: Version
) -> None:
    broker = start_mosquitto()
    rig = MqttRig(settings(broker.port, version=version))
    rig.publisher.set_status("online")
    rig.publisher.put(value(1, 12.0))
    rig.publisher.put(value(2, 400.0, point="line_voltage"))

    async with broker.watch("b/#") as watcher, rig:
        messages = await watcher.until(is_status("online"))

    fresh, *messages = messages
    assert (fresh.topic, fresh.qos) == ("b/gateway/fresh", 0)  # who sees `online` has a token already
    assert [seen.topic for seen in messages] == [
        "b/starter/pump-1/value/current",
        "b/starter/pump-1/value/line_voltage",
        STATUS,
    ]
    assert all(seen.qos == 1 for seen in messages)
    assert messages[0].payload == (
        '{"value":12.0,"unit":"A","quality":"good","time":"2025-10-09T08:53:21.000Z","seq":1,"boot":"boot-1"}'
    )


@BOTH
async def test_what_is_retained_outlives_neither_side_alone_and_is_published_again_after_a_broker_restart(
    start_mosquitto: StartMosquitto, version: Version
) -> None:
    broker = start_mosquitto()
    rig = MqttRig(settings(broker.port, version=version))
    async with rig:
        rig.publisher.set_status("online")
        rig.publisher.put(value(1, 12.0))
        await rig.until_connected()
        broker.kill()
        assert await rig.link() == (False, f"broker 127.0.0.1:{broker.port}: connection lost")
        broker.start()
        await rig.until_connected()

        async with broker.watch("b/#") as watcher:
            messages = await watcher.until(lambda seen: seen.topic == "b/starter/pump-1/value/current")

    assert json.loads(messages[-1].payload)["value"] == 12.0


@BOTH
async def test_events_of_an_outage_arrive_in_order_and_none_is_missing(
    start_mosquitto: StartMosquitto, version: Version
) -> None:
    broker = start_mosquitto(is_persistent=True)
    rig = MqttRig(settings(broker.port, version=version))
    options = ["-i", "historian", "-c"]  # its session outlives the broker
    async with broker.watch("b/starter/+/event", options=options) as watcher, rig:
        await rig.until_connected()
        for seq in range(1, 51):
            rig.publisher.put(event(seq))
        before = await watcher.until(lambda seen: seqs([seen]) == [50])
        broker.stop()
        for seq in range(51, 151):
            rig.publisher.put(event(seq))
        broker.start()
        for seq in range(151, 201):
            rig.publisher.put(event(seq))
        after = await watcher.until(lambda seen: seqs([seen]) == [200])

    first_appearances = list(
        dict.fromkeys(seqs(before + after))
    )  # "at least once" repeats what was in flight
    assert first_appearances == list(range(1, 201))


async def test_values_overtaken_during_an_outage_come_as_history_and_the_newest_as_value(
    start_mosquitto: StartMosquitto,
) -> None:
    broker = start_mosquitto()
    rig = MqttRig(settings(broker.port))
    for seq in range(1, 451):
        rig.publisher.put(value(seq, float(seq)))

    async with broker.watch("b/#") as watcher, rig:
        messages = await watcher.until(lambda seen: "/history" in seen.topic and '"seq":449}' in seen.payload)

    values = [json.loads(seen.payload)["value"] for seen in messages if "/value/" in seen.topic]
    batches = [json.loads(seen.payload) for seen in messages if seen.topic == "b/starter/pump-1/history"]
    assert values == [450.0]
    assert [len(batch["items"]) for batch in batches] == [200, 200, 49]
    assert [item["seq"] for batch in batches for item in batch["items"]] == list(range(1, 450))
    assert batches[0]["boot"] == "boot-1"
    assert batches[0]["items"][0] == {
        "point": "current",
        "value": 1.0,
        "quality": "good",
        "time": "2025-10-09T08:53:21.000Z",
        "seq": 1,
    }


async def test_a_publication_that_the_access_list_forbids_is_counted_and_not_repeated(
    start_mosquitto: StartMosquitto,
) -> None:
    broker = start_mosquitto(
        users={"mcc1": "one", "viewer": "two"},
        acl="user mcc1\ntopic write b/gateway/#\nuser viewer\ntopic readwrite #\n",
    )
    rig = MqttRig(settings(broker.port, username="mcc1", password="one"))
    async with broker.watch("b/#", user=("viewer", "two")) as watcher, rig:
        await rig.until_connected()
        rig.publisher.put(event(1))
        await watcher.until(is_status("starting"))
        rig.publisher.set_status("online")
        messages = await watcher.until(is_status("online"))
        await rig.until_idle()

    assert seqs(messages) == []
    assert rig.outbox.refused == 1
    assert list(rig.outbox.refusals) == [("b/starter/pump-1/event", 0x87)]
    assert rig.outbox.statistics(0.0)["depth"] == 0


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


async def test_a_broker_that_takes_one_message_at_a_time_gets_them_so(
    start_mosquitto: StartMosquitto,
) -> None:
    broker = start_mosquitto(options=["max_inflight_messages 1"])
    rig = MqttRig(settings(broker.port))
    for seq in range(1, 31):
        rig.publisher.put(event(seq))
    async with broker.watch("b/starter/#") as watcher, rig:
        messages = await watcher.until(lambda seen: seqs([seen]) == [30])
        assert rig.connection._session is not None
        window = rig.connection._session.window

    assert window == 1
    assert seqs(messages) == list(range(1, 31))


async def test_a_forgotten_starter_leaves_nothing_retained(start_mosquitto: StartMosquitto) -> None:
    broker = start_mosquitto()
    rig = MqttRig(settings(broker.port))
    async with rig:
        rig.publisher.put(value(1, 12.0))
        await rig.until_connected()
        async with broker.watch("b/#") as watcher:
            await watcher.until(lambda seen: "/value/" in seen.topic and bool(seen.payload))
            rig.publisher.forget("pump-1")
            await watcher.until(lambda seen: "/value/" in seen.topic and not seen.payload)
        async with broker.watch("b/starter/#") as late:
            broker.publish("b/starter/end", "x")
            messages = await late.until(lambda seen: seen.topic == "b/starter/end")

    assert [seen.topic for seen in messages] == ["b/starter/end"]


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
