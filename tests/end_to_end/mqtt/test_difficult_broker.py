"""A broker, or another client of it, that makes life hard; with a real Mosquitto."""

from __future__ import annotations

import asyncio
import shutil
import socket
from pathlib import Path

from gateway.mqtt.connection.settings import TlsSettings
from tests.mosquitto import Certificate, Seen, StartMosquitto
from tests.mqtt.rig import MqttRig, event, settings

ROUNDS = 4
BATCH, EVENTS = 50, 1000  # more at once and the broker would drop what is for the watcher, too
SMALL_BUFFER_BYTES = 4096


def connect_packet(client_id: str) -> bytes:
    """Return an MQTT 3.1.1 CONNECT with a clean session."""
    name = client_id.encode()
    body = b"\x00\x04MQTT\x04\x02\x00\x3c" + len(name).to_bytes(2, "big") + name
    return bytes([0x10, len(body)]) + body


def numbers(messages: list[Seen]) -> list[str]:
    return [each.payload.split('"event ')[1].split('"')[0] for each in messages if '"event ' in each.payload]


async def test_another_client_with_our_name_makes_no_storm_and_loses_no_event(
    start_mosquitto: StartMosquitto,
) -> None:
    broker = start_mosquitto()
    how = settings(broker.port, first_retry_s=0.2, last_retry_s=0.4)
    loop = asyncio.get_running_loop()
    async with broker.watch("b/starter/#") as watcher, MqttRig(how) as rig:
        await rig.until_connected()
        begun_s = loop.time()
        for number in range(1, ROUNDS + 1):
            _, writer = await asyncio.open_connection(broker.host, broker.port)
            writer.write(connect_packet("mcc1"))
            is_connected, _ = await rig.link()
            rig.publisher.put(event(number))
            await rig.until_connected()
            writer.close()
        took_s = loop.time() - begun_s
        messages = await watcher.until(lambda seen: f"event {ROUNDS}" in seen.payload)

    assert not is_connected
    assert [notice.code for notice in rig.notices] == ["client_id_taken"]  # once, though it goes on
    assert "another client uses the client id mcc1" in rig.notices[0].text  # this broker gives no reason
    assert took_s >= ROUNDS * 0.2
    assert broker.log().count("mcc1 already connected") == 2 * ROUNDS
    assert list(dict.fromkeys(numbers(messages))) == [str(number) for number in range(1, ROUNDS + 1)]


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


async def test_an_expired_certificate_is_reported_once_and_its_successor_is_taken_without_a_restart(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    expired, good = Certificate.make_expired(tmp_path), Certificate.make(tmp_path)
    used = Certificate(tmp_path / "used.pem", tmp_path / "used.key")
    shutil.copy(expired.cert, used.cert)
    shutil.copy(expired.key, used.key)
    broker = start_mosquitto(tls=used)
    how = settings(broker.port, host="localhost", tls=TlsSettings(ca_file=str(used.cert)))
    async with MqttRig(how) as rig:
        is_connected, trouble = await rig.link()
        while broker.log().count("New connection") < 4:
            await rig.connection._pause(0.05)
        is_reported_once = rig.links.empty()
        shutil.copy(good.cert, used.cert)
        shutil.copy(good.key, used.key)
        broker.restart()
        await rig.until_connected()

    assert not is_connected
    assert "its certificate: certificate has expired" in trouble
    assert is_reported_once
    assert "CONNECT" not in broker.log().partition("terminating")[0]


async def test_a_subscriber_that_reads_nothing_holds_no_one_up(start_mosquitto: StartMosquitto) -> None:
    broker = start_mosquitto(options=["max_queued_messages 100"])
    subscribe = bytes.fromhex("82 08 0001 0003") + b"b/#" + b"\x01"
    messages: list[Seen] = []
    with socket.socket() as deaf:
        deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, SMALL_BUFFER_BYTES)
        deaf.connect((broker.host, broker.port))
        deaf.sendall(connect_packet("deaf") + subscribe)
        async with broker.watch("b/starter/#") as watcher, MqttRig(settings(broker.port)) as rig:
            await rig.until_connected()
            for last in range(BATCH, EVENTS + 1, BATCH):
                for number in range(last - BATCH + 1, last + 1):
                    rig.publisher.put(event(number))
                messages += await watcher.until(lambda seen, last=last: f'event {last}"' in seen.payload)
            await rig.until_idle()

    assert numbers(messages) == [str(number) for number in range(1, EVENTS + 1)]
    assert "Received SUBSCRIBE from deaf" in broker.log()
    assert "dropped for client deaf" in broker.log()
