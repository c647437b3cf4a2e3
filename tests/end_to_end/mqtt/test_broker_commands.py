"""Commands through a real Mosquitto: only those that were sent while we listened."""

from __future__ import annotations

from gateway.mqtt.connection.reconnect import Version
from tests.mosquitto import StartMosquitto
from tests.mqtt.rig import MqttRig, settings


async def test_a_retained_command_that_is_there_already_is_not_delivered_and_a_live_one_is_seen_as_retained(
    start_mosquitto: StartMosquitto,
) -> None:
    broker = start_mosquitto()
    broker.publish("b/command/pump-1/alice/start", "old", "-r")
    async with MqttRig(settings(broker.port)) as rig:
        await rig.until_connected()
        broker.publish("b/command/pump-2/alice/start", "live", "-r")
        incoming = await rig.command()

    assert (incoming.topic, incoming.payload) == ("b/command/pump-2/alice/start", b"live")
    assert incoming.is_retained
    assert incoming.is_live


async def test_on_mqtt_3_a_retained_command_that_is_there_already_is_seen_as_retained(
    start_mosquitto: StartMosquitto,
) -> None:
    broker = start_mosquitto()
    broker.publish("b/command/pump-1/alice/start", "old", "-r")
    async with MqttRig(settings(broker.port, version=Version.V311)) as rig:
        incoming = await rig.command()

    assert incoming.payload == b"old"
    assert incoming.is_retained
    assert not incoming.is_live


async def test_the_mqtt_5_properties_of_a_command_arrive(start_mosquitto: StartMosquitto) -> None:
    broker = start_mosquitto()
    async with MqttRig(settings(broker.port)) as rig:
        await rig.until_connected()
        broker.publish(
            "b/command/pump-1/alice/start",
            "{}",
            *("-D", "publish", "response-topic", "b/result/pump-1/alice"),
            *("-D", "publish", "correlation-data", "42"),
            *("-D", "publish", "message-expiry-interval", "30"),
        )
        incoming = await rig.command()

    assert incoming.response_topic == "b/result/pump-1/alice"
    assert incoming.correlation == b"42"
    assert incoming.expiry_s == 30
    assert not incoming.is_retained


async def test_a_command_that_was_sent_while_the_gateway_was_away_never_arrives(
    start_mosquitto: StartMosquitto,
) -> None:
    broker = start_mosquitto()
    first = MqttRig(settings(broker.port))
    async with first:
        await first.until_connected()
    broker.publish("b/command/pump-1/alice/start", "while away")
    async with MqttRig(settings(broker.port)) as second:
        await second.until_connected()
        broker.publish("b/command/pump-1/alice/start", "now")
        incoming = await second.command()

    assert incoming.payload == b"now"
