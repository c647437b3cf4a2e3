"""The gateway at brokers that misbehave: too early, too large, in nonsense, with a wrong certificate."""

from __future__ import annotations

import asyncio
import json
import shutil
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from gateway.contract import rfc3339
from gateway.mqtt import BrokerSettings, Message, connected
from gateway.mqtt.connection.client import MAX_INCOMING_BYTES, MOST_SKIPPED_BYTES
from tests.end_to_end.site import PUMP, Program, site_config, write_config
from tests.mosquitto import Certificate, StartMosquitto
from tests.mqtt.fake_broker import ACCEPT_5, ACCEPT_311, LEVEL_5, LEVEL_311, REFUSE_VERSION, FakeBroker
from tests.rig.sites import operator
from tests.waiting import until

STARTER = PUMP + operator("alice", freshness="issued_at")
STOP_FRAME, START_FRAME = ">> 01 05 00 64 00 00", ">> 01 05 00 64 ff 00"
TOO_LARGE = f"bytes, more than {MAX_INCOMING_BYTES}"
both_versions = pytest.mark.parametrize("level", [LEVEL_5, LEVEL_311])


def spoken(level: int) -> dict[int, bytes | None]:
    """Return the answers of a broker that speaks this version of MQTT."""
    return {LEVEL_5: ACCEPT_5 if level == LEVEL_5 else REFUSE_VERSION, LEVEL_311: ACCEPT_311}


def announced(size: int, *, is_retained: bool = False) -> bytes:
    """Return the fixed header of a PUBLISH of so many bytes [MQTT3 2.2.3]."""
    header = bytearray([0x31 if is_retained else 0x30])
    while size >= 0x80:
        header.append(size % 0x80 | 0x80)
        size //= 0x80
    header.append(size)
    return bytes(header)


def command(level: int, verb: str, payload: bytes = b"") -> bytes:
    """Return the packet that brings a command to the gateway."""
    topic = f"starters/plant/command/pump/alice/{verb}".encode()
    body = len(topic).to_bytes(2, "big") + topic + (b"\x00" if level == LEVEL_5 else b"") + payload
    return announced(len(body)) + body


def start(level: int, id_: str) -> bytes:
    """Return a start that was issued just now."""
    body = {"id": id_, "issued_at": rfc3339(time.time()), "ttl_s": 60}
    return command(level, "start", json.dumps(body).encode())


@asynccontextmanager
async def gateway_at(port: int, folder: Path, *, tls: str = "") -> AsyncIterator[Program]:
    """Run the gateway with a simulated starter; with `tls`, keys of its table, at a broker with TLS."""
    text = site_config(broker_port=port, port=str(folder / "ttyHALL"), starters=STARTER)
    if tls:
        text = text.replace("mqtt://127.0.0.1", "mqtts://localhost").replace("[mqtt]\n", f"[mqtt]\n{tls}\n")
    config = write_config(folder, text)
    async with Program("gateway", "simulate", str(config)) as simulator:
        await simulator.says("line hall")
        async with Program("gateway", "run", "-v", str(config)) as gateway:
            yield gateway


async def result(broker: FakeBroker, id_: str) -> str:
    """Return the code of the next result of a command."""
    async with asyncio.timeout(20.0):
        while True:
            packet = await broker.publication()
            _, brace, rest = packet.body.partition(b"{")
            body = json.loads(brace + rest) if packet.topic.startswith("starters/plant/result/") else {}
            if body.get("id") == id_:
                return str(body["code"])


@both_versions
async def test_a_stop_waits_for_no_answer_to_the_subscription(level: int, tmp_path: Path) -> None:
    """It may be late, and is lost with the connection; what is held back until then would be too."""
    stop = command(level, "stop")
    async with (
        FakeBroker(answers=spoken(level), answers_subscriptions=False, before_suback=stop) as broker,
        gateway_at(broker.port, tmp_path) as gateway,
    ):
        await gateway.says(STOP_FRAME)


@both_versions
async def test_a_start_that_comes_with_the_answer_to_the_subscription_is_judged_by_the_connection(
    level: int, tmp_path: Path
) -> None:
    """Held up until then, it may be older than a stop that no gateway was there to take."""
    async with (
        FakeBroker(answers=spoken(level), before_suback=start(level, "first")) as broker,
        gateway_at(broker.port, tmp_path) as gateway,
    ):
        codes = [await result(broker, "first")]
        broker.before_suback, broker.after_suback = b"", start(level, "second")
        broker.hang_up()
        codes.append(await result(broker, "second"))

    assert codes == ["before_connection", "before_connection"]
    assert START_FRAME not in gateway.output


@both_versions
async def test_what_comes_before_the_connection_is_accepted_stops_or_is_refused(
    level: int, tmp_path: Path
) -> None:
    """No broker may do that [MQTT5 3.2]; what another device on its port sends starts nothing."""
    answers = spoken(level)
    answers[level] = start(level, "early") + command(level, "stop") + (answers[level] or b"")
    async with FakeBroker(answers=answers) as broker, gateway_at(broker.port, tmp_path) as gateway:
        assert await result(broker, "early") == "before_connection"
        await gateway.says(STOP_FRAME)


@pytest.mark.parametrize(
    ("nonsense", "reason"),
    [
        ("E0 02 8E 00", "another client has connected with the client id plant"),
        ("00 00", "connection lost"),
        ("90 FF FF FF FF FF FF", "connection lost"),
    ],
)
async def test_what_no_client_can_live_with_ends_the_connection_and_the_next_one_works(
    nonsense: str, reason: str, tmp_path: Path
) -> None:
    async with (
        FakeBroker(after_suback=bytes.fromhex(nonsense)) as broker,
        gateway_at(broker.port, tmp_path) as gateway,
    ):
        await gateway.says(reason)
        broker.after_suback = command(LEVEL_5, "stop")
        await gateway.says(STOP_FRAME)


@pytest.mark.parametrize("code", [0, 0x97])
async def test_each_acknowledgement_is_reported_with_its_reason(code: int) -> None:
    acked: asyncio.Queue[tuple[int, int]] = asyncio.Queue()
    async with FakeBroker(puback_code=code) as broker:
        settings = BrokerSettings("127.0.0.1", broker.port, "g")
        session, _ = await connected(settings, on_ack=lambda *ack: acked.put_nowait(ack))
        for ticket in (1, 2, 3):
            session.publish(ticket, Message("a", b"1", qos=1, retain=False))
        async with asyncio.timeout(10.0):
            found = [await acked.get() for _ in range(3)]
        await session.disconnect()

    assert found == [(1, code), (2, code), (3, code)]


async def test_a_flood_leaves_the_loop_to_others_after_each_reading(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gateway.mqtt.connection.session.READ_FOR_S", 0.0)  # a packet a reading
    flood = 20_000
    arrived: list[object] = []
    async with FakeBroker(after_suback=command(LEVEL_5, "read") * flood) as broker:
        settings = BrokerSettings(host="127.0.0.1", port=broker.port, client_id="plant")
        session, _ = await connected(settings, on_incoming=arrived.append)
        session.listen("starters/plant/command/#", lambda _: None)
        most = 0
        while len(arrived) < flood:
            before = len(arrived)
            await asyncio.sleep(0)
            most = max(most, len(arrived) - before)
        session.abort()
    assert most <= 2, f"{most} readings between two moments of another task"


async def test_many_commands_in_one_tls_record_all_arrive(tmp_path: Path) -> None:
    certificate = Certificate.make(tmp_path)
    many = [command(LEVEL_5, "read", b'{"id":"%d"}' % number) for number in range(250)]
    async with (
        FakeBroker(tls=certificate, after_suback=b"".join([*many, command(LEVEL_5, "stop")])) as broker,
        gateway_at(broker.port, tmp_path, tls=f'ca_file = "{certificate.cert}"') as gateway,
    ):
        await gateway.says(STOP_FRAME)


@both_versions
async def test_a_packet_that_is_announced_too_large_ends_the_connection_before_it_is_read(
    level: int, tmp_path: Path
) -> None:
    packet = announced(MOST_SKIPPED_BYTES + 1)  # and nothing of the rest
    async with (
        FakeBroker(answers=spoken(level), after_suback=packet) as broker,
        gateway_at(broker.port, tmp_path) as gateway,
    ):
        await until(lambda: broker.levels.count(level) >= 3, "three connections")

    warnings = [line for line in gateway.output.splitlines() if " WARNING " in line and TOO_LARGE in line]
    assert len(warnings) == 1  # though it goes on


@pytest.mark.parametrize(
    ("size", "is_retained"), [(MAX_INCOMING_BYTES + 1, False), (20 * MOST_SKIPPED_BYTES, True)]
)
async def test_a_packet_that_is_too_large_is_read_over_and_what_follows_it_comes(
    size: int, is_retained: bool, tmp_path: Path
) -> None:
    topic = b"starters/plant/command/pump/alice/start"
    large = len(topic).to_bytes(2, "big") + topic
    large = announced(size, is_retained=is_retained) + large + bytes(size - len(large))
    after = large + command(LEVEL_311, "stop")
    async with (
        FakeBroker(answers=spoken(LEVEL_311), after_suback=after) as broker,
        gateway_at(broker.port, tmp_path) as gateway,
    ):
        await gateway.says(STOP_FRAME)
        connections = broker.levels.count(LEVEL_311)

    assert f"a packet of {size} {TOO_LARGE}: it was not read" in gateway.output
    assert connections == 1  # it was not lost
    assert START_FRAME not in gateway.output


async def test_a_broker_with_a_foreign_certificate_gets_no_password(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    broker = start_mosquitto(tls=Certificate.make(tmp_path))
    (tmp_path / "secret").write_text("secret")
    (tmp_path / "secret").chmod(0o600)
    async with gateway_at(
        broker.port, tmp_path, tls='username = "plant"\npassword_file = "secret"'
    ) as gateway:
        await gateway.says("its certificate: self")
        await gateway.says("(check ca_file)")

    assert "CONNECT" not in broker.log()


async def test_an_expired_certificate_is_reported_once_and_its_successor_is_taken_without_a_restart(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    expired, good = Certificate.make_expired(tmp_path), Certificate.make(tmp_path)
    used = Certificate(tmp_path / "used.pem", tmp_path / "used.key")
    shutil.copy(expired.cert, used.cert)
    shutil.copy(expired.key, used.key)
    broker = start_mosquitto(tls=used)
    async with gateway_at(broker.port, tmp_path, tls=f'ca_file = "{used.cert}"') as gateway:
        await until(lambda: broker.log().count("New connection") >= 4, "four connections")
        reported = gateway.output.count("its certificate: certificate has expired")
        shutil.copy(good.cert, used.cert)
        shutil.copy(good.key, used.key)
        broker.restart()
        await until(lambda: " as plant " in broker.log(), "a client")

    assert reported == 1
    assert "CONNECT" not in broker.log().partition("terminating")[0]
