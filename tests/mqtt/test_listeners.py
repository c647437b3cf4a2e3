"""Topics beside those of commands: nothing on them is a command, and a refusal costs nothing else."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable

import pytest

from tests.mqtt.fake_broker import LEVEL_5, SUBSCRIBE, FakeBroker, Packet
from tests.mqtt.rig import MqttRig, settings

BIRTH = "homeassistant/status"


class ListeningBroker(FakeBroker):
    """Notes the topics of SUBSCRIBE and UNSUBSCRIBE; refuses those in `refused`."""

    def __init__(self) -> None:
        super().__init__()
        self.subscribed: list[str] = []
        self.unsubscribed: list[str] = []
        self.refused: set[str] = set()

    async def _answer(self, packet: Packet, writer: asyncio.StreamWriter) -> bool:
        if packet.kind in (SUBSCRIBE, 10):
            start = 2 + (1 if self.levels[-1] == LEVEL_5 else 0)
            size = int.from_bytes(packet.body[start : start + 2], "big")
            topic = packet.body[start + 2 : start + 2 + size].decode()
            (self.subscribed if packet.kind == SUBSCRIBE else self.unsubscribed).append(topic)
            self.suback_code = 0x87 if topic in self.refused else 1
        return await super()._answer(packet, writer)

    def send(self, topic: str, payload: bytes) -> None:
        """Publish to the newest client, with QoS 0."""
        name = topic.encode()
        body = len(name).to_bytes(2, "big") + name + b"\x00" + payload
        self._writers[-1].write(bytes([0x30, len(body)]) + body)


async def until(is_true: Callable[[], object]) -> None:
    async with asyncio.timeout(10.0):
        while not is_true():  # noqa: ASYNC110 - the fake broker has no events
            await asyncio.sleep(0.01)


async def test_a_message_there_goes_to_the_listener_and_never_among_the_commands() -> None:
    taken: list[bytes] = []
    async with ListeningBroker() as broker, MqttRig(settings(broker.port)) as rig:
        rig.connection.listen(BIRTH, taken.append)
        await rig.until_connected()
        await until(lambda: broker.subscribed == ["b/command/#", BIRTH])
        broker.send(BIRTH, b'{"id":"1","token":"x"}')
        broker.send("b/command/p/alice/stop", b"")
        command = await rig.command()
        await until(lambda: taken)

        assert taken == [b'{"id":"1","token":"x"}']
        assert command.topic == "b/command/p/alice/stop"
        assert rig.incoming.empty()


async def test_it_begins_and_ends_on_a_connection_that_stands_and_goes_on_over_the_next() -> None:
    taken: list[bytes] = []
    async with ListeningBroker() as broker, MqttRig(settings(broker.port)) as rig:
        await rig.until_connected()
        rig.connection.listen(BIRTH, taken.append)
        await until(lambda: BIRTH in broker.subscribed)
        broker.hang_up()
        await rig.until_connected()
        await until(lambda: broker.subscribed.count(BIRTH) == 2)
        rig.connection.unlisten(BIRTH)
        await until(lambda: broker.unsubscribed == [BIRTH])
        broker.send(BIRTH, b"online")
        incoming = await rig.command()

        assert taken == []
        assert rig.topics.parse_command(incoming.topic) is None  # as any other foreign message


async def test_a_refused_subscription_is_logged_and_commands_still_arrive(
    caplog: pytest.LogCaptureFixture,
) -> None:
    with caplog.at_level(logging.WARNING):
        async with ListeningBroker() as broker, MqttRig(settings(broker.port)) as rig:
            broker.refused = {BIRTH}
            rig.connection.listen(BIRTH, lambda _: None)
            await rig.until_connected()
            await until(lambda: BIRTH in broker.subscribed)
            broker.send("b/command/p/alice/stop", b"")
            await rig.command()
            await until(lambda: "refuses a subscription to homeassistant/status" in caplog.text)


async def test_a_listener_that_fails_ends_neither_the_connection_nor_the_commands() -> None:
    def fail(_: bytes) -> None:
        raise ValueError("ordered")

    seen: list[object] = []
    asyncio.get_running_loop().set_exception_handler(lambda _, context: seen.append(context["exception"]))
    async with ListeningBroker() as broker, MqttRig(settings(broker.port)) as rig:
        rig.connection.listen(BIRTH, fail)
        await rig.until_connected()
        broker.send(BIRTH, b"online")
        broker.send("b/command/p/alice/stop", b"")
        await rig.command()

        assert rig.links.empty()  # it was not lost
        assert [str(each) for each in seen] == ["ordered"]
