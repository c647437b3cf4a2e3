"""The connection against brokers that misbehave, on loopback and in real time."""

from __future__ import annotations

import logging
from pathlib import Path

import pytest

from gateway.mqtt.connection.packet_limit import MAX_INCOMING_BYTES, MOST_SKIPPED_BYTES
from gateway.mqtt.connection.reconnect import Version, taken_over
from gateway.mqtt.connection.settings import BrokerSettings, TlsSettings
from gateway.mqtt.contract.commands import MAX_PAYLOAD_BYTES
from tests.mosquitto import Certificate
from tests.mqtt.fake_broker import LEVEL_5, LEVEL_311, FakeBroker
from tests.mqtt.rig import MqttRig, settings


@pytest.mark.parametrize(
    ("nonsense", "reason"),
    [
        ("E0 02 8E 00", taken_over("mcc1").text),
        ("00 00", "connection lost"),
        ("90 FF FF FF FF FF FF", "connection lost"),
    ],
)
async def test_what_no_client_can_live_with_ends_the_connection_and_the_next_one_works(
    nonsense: str, reason: str
) -> None:
    async with (
        FakeBroker(after_suback=bytes.fromhex(nonsense)) as broker,
        MqttRig(settings(broker.port)) as rig,
    ):
        await rig.until_connected()
        is_connected, trouble = await rig.link()
        broker.after_suback = b""
        await rig.until_connected()

    assert not is_connected
    assert trouble == f"broker 127.0.0.1:{broker.port}: {reason}"


async def test_many_commands_in_one_tls_record_all_arrive(tmp_path: Path) -> None:
    certificate = Certificate.make(tmp_path)
    many = bytes.fromhex("30 06 00 01 61 00 68 69") * 250
    how = {"host": "localhost", "tls": TlsSettings(ca_file=str(certificate.cert))}
    async with (
        FakeBroker(tls=certificate, after_suback=many) as broker,
        MqttRig(settings(broker.port, **how)) as rig,
    ):
        for _ in range(250):
            await rig.command()


@pytest.mark.parametrize("level", [LEVEL_5, LEVEL_311])
async def test_a_packet_that_is_announced_too_large_ends_the_connection_before_it_is_read(
    level: int, caplog: pytest.LogCaptureFixture
) -> None:
    size = MOST_SKIPPED_BYTES + 1
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
