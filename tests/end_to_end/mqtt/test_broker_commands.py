"""Commands through a real Mosquitto: only those that were sent while we listened."""

from __future__ import annotations

from tests.mosquitto import StartMosquitto
from tests.mqtt.rig import MqttRig, settings


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
