"""A connection to brokers that misbehave: too early, too large, in nonsense, with a wrong certificate."""

from __future__ import annotations

import asyncio
import shutil
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from gateway.contract import MAX_PAYLOAD_BYTES, Event
from gateway.mqtt import (
    BrokerConnection,
    BrokerSettings,
    Hooks,
    Incoming,
    Message,
    Outbox,
    SessionParts,
    TlsSettings,
    connected,
)
from gateway.mqtt.connection.client import MAX_INCOMING_BYTES, MOST_SKIPPED_BYTES
from tests.mosquitto import Certificate
from tests.mqtt.fake_broker import ACCEPT_5, ACCEPT_311, LEVEL_5, LEVEL_311, REFUSE_VERSION, FakeBroker
from tests.waiting import until

TOPIC = "b/command/pump/alice"


@pytest.fixture(autouse=True)
def _soon(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gateway.mqtt.connection.broker.FIRST_RETRY_S", 0.05)


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
    topic = f"{TOPIC}/{verb}".encode()
    body = len(topic).to_bytes(2, "big") + topic + (b"\x00" if level == LEVEL_5 else b"") + payload
    return announced(len(body)) + body


@dataclass
class Link:
    """All that a connection reports."""

    commands: list[Incoming] = field(default_factory=list)
    states: list[tuple[bool, str]] = field(default_factory=list)
    notices: list[Event] = field(default_factory=list)

    async def gets(self, *verbs: str) -> None:
        """Wait for commands, of which no other comes before them."""
        await until(lambda: len(self.commands) >= len(verbs), f"{verbs}, found {self.commands}")
        assert [each.topic.removeprefix(f"{TOPIC}/") for each in self.commands] == list(verbs)

    async def says(self, trouble: str) -> None:
        await until(lambda: any(trouble in said for _, said in self.states), f"{trouble} in {self.states}")


@asynccontextmanager
async def linked(broker: FakeBroker, **settings: Any) -> AsyncIterator[Link]:
    """Keep connected, as the gateway does."""
    link = Link()
    hooks = Hooks(
        will=lambda: Message("b/will", b"", 1, retain=True),
        on_incoming=link.commands.append,
        on_link=lambda version, trouble: link.states.append((version is not None, trouble)),
        on_notice=link.notices.append,
        on_read=lambda _: None,
        pulse=lambda: Message("b/pulse", b"", 0, retain=False),
    )
    way = BrokerSettings("localhost", broker.port, "plant", **settings)
    connection = BrokerConnection(way, Outbox(last_topic=""), command_filter="b/command/#", hooks=hooks)
    running = asyncio.create_task(connection.run())
    yield link
    running.cancel()
    await asyncio.wait([running])


@both_versions
async def test_a_stop_waits_for_no_answer_to_the_subscription(level: int) -> None:
    """It may be late, and is lost with the connection; what is held back until then would be too."""
    stop = command(level, "stop")
    silent = FakeBroker(spoken(level), answers_subscriptions=False, before_suback=stop)
    async with silent as broker, linked(broker) as link:
        await link.gets("stop")


@both_versions
async def test_what_comes_before_the_connection_is_reported_is_early(level: int) -> None:
    """With the answer to the subscription it may be older than a stop that no gateway was there to take.

    Before CONNACK no broker may send it [MQTT5 3.2]: another device on its port may.
    """
    answers = spoken(level)
    answers[level] = command(level, "start") + command(level, "stop") + (answers[level] or b"")
    async with FakeBroker(answers, before_suback=command(level, "jog")) as broker, linked(broker) as link:
        await link.gets("start", "stop", "jog")
        link.commands.clear()
        broker.answers, broker.before_suback = spoken(level), b""
        broker.after_suback = command(level, "reset")
        broker.hang_up()
        await link.gets("reset")
        early = [*link.commands]
        await until(lambda: link.states[-1] == (True, ""), "a connection")
        broker.send(command(level, "read"))
        await link.gets("reset", "read")

    assert [each.is_early for each in (*early, link.commands[-1])] == [True, False]


@pytest.mark.parametrize(
    ("nonsense", "reason"),
    [
        ("E0 02 8E 00", "another client has connected with the client id plant"),
        ("00 00", "connection lost"),
        ("90 FF FF FF FF FF FF", "connection lost"),
    ],
)
async def test_what_no_client_can_live_with_ends_the_connection_and_the_next_one_works(
    nonsense: str, reason: str
) -> None:
    async with FakeBroker(after_suback=bytes.fromhex(nonsense)) as broker, linked(broker) as link:
        await link.says(reason)
        broker.after_suback = command(LEVEL_5, "stop")
        await link.gets("stop")


@pytest.mark.parametrize("code", [0, 0x97])
async def test_each_acknowledgement_is_reported_with_its_reason(code: int) -> None:
    acked: list[tuple[int, int]] = []
    async with FakeBroker(puback_code=code) as broker:
        settings = BrokerSettings("127.0.0.1", broker.port, "g")
        session = await connected(settings, SessionParts(on_ack=lambda *ack: acked.append(ack)))
        for ticket in (1, 2, 3):
            session.publish(ticket, Message("a", b"1", qos=1, retain=False))
        await until(lambda: len(acked) == 3, "three acknowledgements")
        await session.disconnect()

    assert acked == [(1, code), (2, code), (3, code)]


async def test_a_flood_leaves_the_loop_to_others_after_each_reading(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gateway.mqtt.connection.session.READ_FOR_S", 0.0)  # a packet a reading
    flood = 5_000
    arrived: list[object] = []
    async with FakeBroker(after_suback=command(LEVEL_5, "read") * flood) as broker:
        settings = BrokerSettings(host="127.0.0.1", port=broker.port, client_id="plant")
        session = await connected(settings, SessionParts(on_incoming=arrived.append))
        session.read("b/command/#", lambda _: None)
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
        linked(broker, tls=TlsSettings(str(certificate.cert))) as link,
    ):
        await link.gets(*["read"] * 250, "stop")


@both_versions
async def test_a_packet_that_is_announced_too_large_ends_the_connection_before_it_is_read(level: int) -> None:
    packet = announced(MOST_SKIPPED_BYTES + 1)  # and nothing of the rest
    async with FakeBroker(spoken(level), after_suback=packet) as broker, linked(broker) as link:
        await until(lambda: broker.levels.count(level) >= 3, "three connections")

    assert [each.code for each in link.notices] == ["message_too_large"]  # though it goes on


@pytest.mark.parametrize(
    ("size", "is_retained"), [(MAX_INCOMING_BYTES + 1, False), (20 * MOST_SKIPPED_BYTES, True)]
)
async def test_a_packet_that_is_too_large_is_read_over_and_what_follows_it_comes(
    *, size: int, is_retained: bool
) -> None:
    topic = f"{TOPIC}/start".encode()
    large = len(topic).to_bytes(2, "big") + topic
    large = announced(size, is_retained=is_retained) + large + bytes(size - len(large))
    after = large + command(LEVEL_311, "stop")
    async with FakeBroker(spoken(LEVEL_311), after_suback=after) as broker, linked(broker) as link:
        await until(lambda: link.commands and link.commands[-1].topic == f"{TOPIC}/stop", "a stop")

    assert broker.levels.count(LEVEL_311) == 1  # the connection was not lost
    assert [f"a packet of {size} bytes" in each.text for each in link.notices] == [True]
    assert all(len(each.payload) > MAX_PAYLOAD_BYTES for each in link.commands[:-1])  # it is refused


async def test_a_broker_with_a_foreign_certificate_gets_no_login(tmp_path: Path) -> None:
    foreign = FakeBroker(tls=Certificate.make(tmp_path))
    async with foreign as broker, linked(broker, tls=TlsSettings(), password="secret") as link:
        await link.says("(check ca_file)")

    assert broker.levels == []


async def test_an_expired_certificate_is_reported_once_and_its_successor_is_taken_without_a_restart(
    tmp_path: Path,
) -> None:
    expired, good = Certificate.make_expired(tmp_path), Certificate.make(tmp_path)
    authority = tmp_path / "ca.pem"
    shutil.copy(expired.cert, authority)
    trust = TlsSettings(str(authority))
    async with FakeBroker(tls=expired) as broker, linked(broker, tls=trust) as link:
        await until(lambda: broker.attempts >= 4, "four attempts")
        reported = [*link.states]
        shutil.copy(good.cert, authority)
        broker.use(good)
        await until(lambda: link.states[-1] == (True, ""), "a connection")

    assert len(reported) == 1
    assert "its certificate: certificate has expired" in reported[0][1]
