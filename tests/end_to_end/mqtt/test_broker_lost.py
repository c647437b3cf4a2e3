"""Connections that are missing, lost, or ended."""

from __future__ import annotations

import asyncio
import logging
import socket
from pathlib import Path

import pytest

from gateway.mqtt.connection.packet_limit import MAX_INCOMING_BYTES, MOST_SKIPPED_BYTES
from gateway.mqtt.connection.reconnect import Version
from gateway.mqtt.connection.settings import BrokerSettings, TlsSettings
from gateway.mqtt.contract.commands import MAX_PAYLOAD_BYTES
from tests.mqtt.fake_broker import (
    DISCONNECT,
    HANG_UP,
    LEVEL_5,
    LEVEL_311,
    PINGREQ,
    PUBLISH,
    FakeBroker,
)
from tests.mqtt.rig import MqttRig, settings


async def test_a_missing_broker_is_reported_once_and_found_when_it_comes() -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        async with MqttRig(settings(probe.getsockname()[1])) as rig:
            is_connected, trouble = await rig.link()

    assert not is_connected
    assert trouble.endswith("nothing listens there (is the broker running?)")


async def test_an_unusable_certificate_file_is_reported_and_not_fatal(tmp_path: Path) -> None:
    how = settings(1, tls=TlsSettings(ca_file=str(tmp_path / "missing.pem")))
    async with MqttRig(how) as rig:
        is_connected, trouble = await rig.link()
        assert rig.task is not None
        assert not rig.task.done()

    assert not is_connected
    assert trouble.startswith("ca_file ")


async def test_an_end_that_is_not_acknowledged_takes_no_longer_than_allowed_and_keeps_the_will() -> None:
    async with FakeBroker(acknowledges=False) as broker, MqttRig(settings(broker.port)) as rig:
        await rig.until_connected()
        async with asyncio.timeout(5.0):
            await rig.connection.close(rig.publisher.farewell("stopped"), within_s=0.2)
            assert rig.task is not None
            await rig.task

        kinds = [broker.received.get_nowait().kind for _ in range(broker.received.qsize())]
        assert PUBLISH in kinds
        assert DISCONNECT not in kinds


async def test_an_end_with_a_full_window_and_no_acknowledgement_leaves_the_last_word_to_the_will() -> None:
    async with FakeBroker(acknowledges=False) as broker, MqttRig(settings(broker.port, window=1)) as rig:
        await rig.until_connected()
        await broker.publication()
        async with asyncio.timeout(5.0):
            await rig.connection.close(rig.publisher.farewell("stopped"), within_s=0.2)

        assert broker.received.empty()


async def test_an_end_before_any_connection_is_at_once_and_stops_the_retries() -> None:
    async with (
        FakeBroker(answers={LEVEL_5: HANG_UP, LEVEL_311: HANG_UP}) as broker,
        MqttRig(settings(broker.port, first_retry_s=30.0, last_retry_s=30.0)) as rig,
    ):
        await rig.link()
        async with asyncio.timeout(5.0):
            await rig.connection.close(rig.publisher.farewell("stopped"))
            assert rig.task is not None
            await rig.task


async def test_a_connection_attempt_can_be_cancelled_while_it_blocks() -> None:
    async with FakeBroker() as broker:  # it speaks no TLS, so the handshake hangs
        rig = MqttRig(settings(broker.port, tls=TlsSettings()))
        async with rig:
            async with asyncio.timeout(5.0):
                await broker.is_reached.wait()
            async with asyncio.timeout(1.0):
                await rig.vanish()


async def test_a_broker_that_falls_silent_is_noticed_and_left() -> None:
    async with (
        FakeBroker(answers_pings=False) as broker,
        MqttRig(settings(broker.port, keepalive_s=1, pong_s=1.0)) as rig,
    ):
        await rig.until_connected()
        is_connected, trouble = await rig.link()

    assert not is_connected
    assert trouble.endswith("the broker has stopped answering")


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


async def test_after_connections_that_held_the_next_one_comes_soon() -> None:
    async with (
        FakeBroker() as broker,
        MqttRig(settings(broker.port, steady_s=0.0, last_retry_s=100.0)) as rig,
    ):
        for _ in range(12):
            await rig.until_connected()
            broker._writers[-1].close()


async def test_the_last_word_after_short_connections_is_connected_once_one_holds(
    caplog: pytest.LogCaptureFixture,
) -> None:
    with caplog.at_level(logging.INFO, "gateway.mqtt.connection.broker"):
        async with FakeBroker() as broker, MqttRig(settings(broker.port, steady_s=0.3)) as rig:
            for _ in range(3):
                await rig.until_connected()
                broker.hang_up()
            await rig.until_connected()
            said_before = [record.getMessage() for record in caplog.records]
            await asyncio.sleep(1.0)

    said = [record.getMessage().endswith("connected, MQTT 5") for record in caplog.records]
    assert len(said_before) == 2
    assert said == [True, False, True]


async def test_nothing_is_published_after_the_loss_of_the_connection() -> None:
    async with FakeBroker() as broker, MqttRig(settings(broker.port)) as rig:
        await rig.until_connected()
        session = rig.connection._session
        assert session is not None
        broker._writers[-1].close()
        await session.lost

        assert session.publish(99, rig.publisher.will()) is None
        assert session.in_flight < session.window


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


async def test_connections_that_end_at_once_without_a_reason_may_be_another_clients_doing() -> None:
    async with FakeBroker(closes_after_suback=True) as broker, MqttRig(v311(broker.port)) as rig:
        for _ in range(4):
            await rig.until_connected()

    assert [notice.code for notice in rig.notices] == ["client_id_taken"]
    assert "perhaps another client uses the client id mcc1" in rig.notices[0].text


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
