"""What stands unread in a socket, with a real Mosquitto."""

from __future__ import annotations

import asyncio

from gateway.mqtt.connection.broker import BrokerConnection
from gateway.mqtt.connection.unread import Unread
from gateway.mqtt.contract.commands import Incoming
from tests.mosquitto import StartMosquitto
from tests.mqtt.rig import MqttRig, settings


async def test_a_command_is_unread_from_the_socket_until_it_has_been_handed_over(
    start_mosquitto: StartMosquitto,
) -> None:
    broker = start_mosquitto()
    unread = Unread()
    states: list[bool] = []
    taken = asyncio.Event()
    rig = MqttRig(settings(broker.port))

    def take(_incoming: Incoming) -> None:
        states.append(unread())
        taken.set()

    rig.connection = BrokerConnection(
        settings(broker.port),
        rig.outbox,
        command_filter=rig.topics.command_filter,
        will=rig.publisher.will,
        on_incoming=take,
        on_link=lambda is_connected, trouble: rig.links.put_nowait((is_connected, trouble)),
        unread=unread,
    )
    async with rig:
        await rig.until_connected()
        broker.publish("b/command/pump-1/alice/stop", "")  # blocks the loop: it waits in the socket
        async with asyncio.timeout(10.0):
            while not unread():  # noqa: ASYNC110 - the kernel sets no event
                await asyncio.sleep(0)
            await taken.wait()
            while unread():  # noqa: ASYNC110 - the reader's own end sets no event
                await asyncio.sleep(0)
    assert states == [True]
    assert not unread()
