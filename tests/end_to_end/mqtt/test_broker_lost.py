"""Connections that are missing, lost, or ended."""

from __future__ import annotations

import asyncio
import logging
from pathlib import Path

import pytest

from gateway.mqtt.connection.packet_limit import MAX_INCOMING_BYTES, MOST_SKIPPED_BYTES
from gateway.mqtt.connection.reconnect import Version
from gateway.mqtt.connection.settings import BrokerSettings, TlsSettings
from gateway.mqtt.contract.commands import MAX_PAYLOAD_BYTES
from tests.mqtt.fake_broker import (
    LEVEL_5,
    LEVEL_311,
    PINGREQ,
    FakeBroker,
)
from tests.mqtt.rig import MqttRig, settings


async def test_an_unusable_certificate_file_is_reported_and_not_fatal(tmp_path: Path) -> None:
    how = settings(1, tls=TlsSettings(ca_file=str(tmp_path / "missing.pem")))
    async with MqttRig(how) as rig:
        is_connected, trouble = await rig.link()
        assert rig.task is not None
        assert not rig.task.done()

    assert not is_connected
    assert trouble.startswith("ca_file ")


async def test_a_connection_attempt_can_be_cancelled_while_it_blocks() -> None:
    async with FakeBroker() as broker:  # it speaks no TLS, so the handshake hangs
        rig = MqttRig(settings(broker.port, tls=TlsSettings()))
        async with rig:
            async with asyncio.timeout(5.0):
                await broker.is_reached.wait()
            async with asyncio.timeout(1.0):
                await rig.vanish()


async def test_a_broker_that_is_late_with_its_answer_to_a_ping_is_not_left() -> None:
    async with (
        FakeBroker(answers_pings=False) as broker,
        MqttRig(settings(broker.port, keepalive_s=1)) as rig,
    ):
        await rig.until_connected()
        await asyncio.sleep(4.0)
        received = [broker.received.get_nowait().kind for _ in range(broker.received.qsize())]

        assert received.count(PINGREQ) == 1
        assert rig.links.empty()


@pytest.mark.parametrize("level", [LEVEL_5, LEVEL_311])
@pytest.mark.parametrize("size", [MOST_SKIPPED_BYTES + 1, 200_000_000])
async def test_a_packet_that_is_announced_too_large_ends_the_connection_before_it_is_read(
    level: int, size: int, caplog: pytest.LogCaptureFixture
) -> None:
    version = Version.V5 if level == LEVEL_5 else Version.V311
    with caplog.at_level(logging.WARNING):
        async with (
            FakeBroker(after_suback=announced(size)) as broker,  # which sends nothing of the rest
            MqttRig(settings(broker.port, version=version)) as rig,
        ):
            for _ in range(3):
                await rig.until_connected()
                is_connected, trouble = await rig.link()
                assert not is_connected
                assert f"a packet of {size} bytes, more than {MAX_INCOMING_BYTES}" in trouble

    assert [notice.code for notice in rig.notices] == ["message_too_large"]
    assert [record.levelname for record in caplog.records] == ["WARNING"]  # once, though it goes on
    assert broker.levels[:3] == [level] * 3


@pytest.mark.parametrize(
    ("size", "is_retained"),
    [
        (MAX_INCOMING_BYTES + 1, False),
        (MOST_SKIPPED_BYTES, False),
        (MAX_INCOMING_BYTES + 1, True),
        (20 * MOST_SKIPPED_BYTES, True),
    ],
)
async def test_a_packet_that_is_too_large_is_read_over_and_what_follows_it_comes(
    size: int, is_retained: bool
) -> None:
    large = b"\x00\x0eb/command/p1/a" + bytes(size - 16)
    small = b"\x00\x0eb/command/p1/c"
    packets = announced(size, is_retained=is_retained) + large + announced(len(small)) + small
    async with FakeBroker(after_suback=packets) as broker, MqttRig(v311(broker.port)) as rig:
        first, second = await rig.command(), await rig.command()
        assert await rig.link() == (True, "")
        assert rig.links.empty()  # it was not lost

    assert (first.topic, first.is_retained) == ("b/command/p1/a", is_retained)
    assert MAX_PAYLOAD_BYTES < len(first.payload) <= 2 * MAX_INCOMING_BYTES
    assert (second.topic, second.payload) == ("b/command/p1/c", b"")
    assert [notice.code for notice in rig.notices] == ["message_too_large"]
    assert f"a packet of {size} bytes, more than {MAX_INCOMING_BYTES}: it was not read" in rig.notices[0].text


async def test_a_topic_of_the_greatest_length_is_read_over_too() -> None:
    topic = b"b/command/" + b"x" * 65_525
    body = len(topic).to_bytes(2, "big") + topic + bytes(100)
    packets = announced(len(body), is_retained=True) + body
    async with FakeBroker(after_suback=packets) as broker, MqttRig(v311(broker.port)) as rig:
        incoming = await rig.command()

    assert incoming.topic == topic.decode()


async def test_a_packet_of_the_largest_size_is_read() -> None:
    packet = announced(MAX_INCOMING_BYTES)
    topic = b"\x00\x0eb/command/p1/a"
    body = topic + bytes(MAX_INCOMING_BYTES - len(topic))
    async with FakeBroker(after_suback=packet + body) as broker, MqttRig(v311(broker.port)) as rig:
        incoming = await rig.command()

    assert (incoming.topic, rig.notices) == ("b/command/p1/a", [])


def v311(port: int) -> BrokerSettings:
    return settings(port, version=Version.V311)


def announced(size: int, *, is_retained: bool = False) -> bytes:
    """Return the fixed header of a PUBLISH of so many bytes [MQTT3 2.2.3]."""
    header = bytearray([0x31 if is_retained else 0x30])
    while size >= 0x80:
        header.append(size % 0x80 | 0x80)
        size //= 0x80
    header.append(size)
    return bytes(header)
