"""What the node's CONNECT says, as the connection hands it to the MQTT library."""

from __future__ import annotations

import asyncio

import pytest

from gateway.app.integrations.sparkplug import LARGEST_PACKET
from gateway.mqtt.connection.reconnect import Version
from gateway.mqtt.connection.session import Session, SessionParts
from gateway.mqtt.connection.settings import BrokerSettings
from tests.sparkplug.support import NodeRig


@pytest.mark.parametrize("version", [Version.V311, Version.V5])
async def test_a_connect_is_clean_with_a_will_of_qos_1_that_is_not_retained(version: Version) -> None:
    connects: list[bytes] = []
    is_there = asyncio.Event()

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        connects.append(await reader.read(4096))
        is_there.set()
        writer.close()

    death = NodeRig().node.death(7, 1.0)
    async with await asyncio.start_server(serve, "127.0.0.1", 0) as server:
        port = server.sockets[0].getsockname()[1]
        session = Session(
            BrokerSettings("127.0.0.1", port, "mcc1-spb", largest_packet=LARGEST_PACKET),
            version,
            SessionParts(death, on_incoming=lambda _: None, on_ack=lambda *_: None),
        )
        connecting = asyncio.create_task(session.connect())
        await asyncio.wait_for(is_there.wait(), 10.0)
        connecting.cancel()
        await asyncio.gather(connecting, return_exceptions=True)
        session.abort()

    flags = connects[0][connects[0].index(b"MQTT") + 5]
    assert flags == 0b0000_1110  # clean, will, will QoS 1; neither retained nor a login [MQTT3 3.1.2.3]
    assert death.payload in connects[0]
    if version is Version.V5:
        assert b"\x27\x00\x00\x20\x00" in connects[0]  # Maximum Packet Size 8192 [MQTT5 3.1.2.11.4]
        assert b"\x11\x00\x00\x00\x00" in connects[0]  # Session Expiry Interval 0 [MQTT5 3.1.2.11.2]
