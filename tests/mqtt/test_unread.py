"""Whether the broker has sent something that no one has dealt with yet."""

from __future__ import annotations

import asyncio
import socket

import pytest

from gateway.mqtt.connection.broker import BrokerConnection
from gateway.mqtt.connection.unread import Unread
from gateway.mqtt.contract.commands import Incoming
from tests.conftest import StartMosquitto
from tests.mqtt.rig import Rig, settings


def test_what_waits_in_the_socket_is_unread_until_it_is_read() -> None:
    unread = Unread()
    ours, theirs = socket.socketpair()
    with ours, theirs:
        unread.watch(ours.fileno())
        assert not unread()

        theirs.send(b"stop")
        assert unread()

        ours.recv(100)
        assert not unread()


def test_what_is_being_read_is_unread_until_it_has_been_dealt_with() -> None:
    unread = Unread()
    unread.begin()
    assert unread()
    unread.end()
    assert not unread()


@pytest.mark.parametrize("is_reported", [True, False])
def test_a_socket_that_is_closed_has_nothing_unread(is_reported: bool) -> None:
    unread = Unread()
    ours, theirs = socket.socketpair()
    unread.watch(ours.fileno())
    theirs.send(b"stop")
    if is_reported:
        unread.forget()
    ours.close()
    theirs.close()
    assert not unread()


@pytest.mark.mosquitto
async def test_a_command_is_unread_from_the_socket_until_it_has_been_handed_over(
    start_mosquitto: StartMosquitto,
) -> None:
    broker = start_mosquitto()
    unread = Unread()
    states: list[bool] = []
    taken = asyncio.Event()
    rig = Rig(settings(broker.port))

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
