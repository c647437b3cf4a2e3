"""The connection against brokers that misbehave, on loopback and in real time."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from gateway.mqtt.connection.reconnect import taken_over
from gateway.mqtt.connection.settings import TlsSettings
from tests.mosquitto import Certificate
from tests.mqtt.fake_broker import (
    LEVEL_5,
    FakeBroker,
)
from tests.mqtt.rig import MqttRig, event, settings, value


async def test_a_message_larger_than_the_broker_takes_is_set_aside_and_the_next_one_sent() -> None:
    packets_up_to_400 = bytes.fromhex("20 08 00 00 05 27 00 00 01 90")
    async with FakeBroker(answers={LEVEL_5: packets_up_to_400}) as broker:
        rig = MqttRig(settings(broker.port))
        rig.publisher.put(value(1, 1.0))
        rig.publisher.put(event(1))
        rig.outbox.put(rig.payloads.history("b/starter/pump-1/history", ["0" * 500], "boot-1"), 0.0)
        rig.publisher.put(event(2))
        async with rig:
            topics = [(await broker.publication()).topic for _ in range(4)]
            await rig.until_idle()

    assert topics == [
        "b/starter/pump-1/value/current",
        "b/gateway/status",
        "b/starter/pump-1/event",
        "b/starter/pump-1/event",
    ]
    assert list(rig.outbox.refusals) == [("b/starter/pump-1/history", 0x95)]


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


async def test_a_command_on_a_topic_that_is_not_utf_8_is_ignored() -> None:
    bad = bytes.fromhex("30 05 00 02 FF FE 00")
    good = bytes.fromhex("30 06 00 01 61 00 68 69")
    async with FakeBroker(after_suback=bad + good) as broker, MqttRig(settings(broker.port)) as rig:
        incoming = await rig.command()

    assert (incoming.topic, incoming.payload) == ("a", b"hi")


async def test_a_callback_that_fails_does_not_end_the_connection() -> None:
    failures: asyncio.Queue[dict[str, object]] = asyncio.Queue()
    asyncio.get_running_loop().set_exception_handler(lambda _, context: failures.put_nowait(context))
    two = bytes.fromhex("30 06 00 01 61 00 68 69") * 2
    async with FakeBroker(after_suback=two) as broker:
        rig = MqttRig(settings(broker.port))
        rig.connection._on_incoming = lambda incoming: [][0]  # an IndexError
        async with rig:
            await rig.until_connected()
            for _ in range(2):
                async with asyncio.timeout(5.0):
                    assert isinstance((await failures.get())["exception"], IndexError)
            await rig.until_idle()
            assert rig.links.empty()  # it was not lost


async def test_a_bug_in_an_acknowledgement_ends_the_session_with_its_reason() -> None:
    async with FakeBroker() as broker:
        rig = MqttRig(settings(broker.port))
        acked = rig.outbox.acked

        def fail_once(ticket: int, code: int) -> None:
            rig.outbox.acked = acked  # type: ignore[method-assign]  # the fault lasts for one call
            raise KeyError("lost ticket")

        rig.outbox.acked = fail_once  # type: ignore[method-assign, assignment]  # the fault
        async with rig:
            await rig.until_connected()
            is_connected, trouble = await rig.link()
            await rig.until_connected()
            await rig.until_idle()

    assert not is_connected
    assert trouble.endswith("cannot be read: KeyError('lost ticket')")


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


async def test_acknowledgements_are_answered_by_the_half_window_not_one_by_one() -> None:
    async with FakeBroker(acknowledges=False) as broker, MqttRig(settings(broker.port, window=4)) as rig:
        await rig.until_connected()
        for seq in range(7):
            rig.publisher.put(event(seq))
        session = rig.connection._session
        assert session is not None
        in_flight = []
        async with asyncio.timeout(10.0):
            while session.in_flight < session.window:  # noqa: ASYNC110 - a few rounds
                await asyncio.sleep(0)
            for _ in range(8):  # the gateway's status is one
                before = session.in_flight
                broker.acknowledge(await broker.publication())
                while session.in_flight == before:  # noqa: ASYNC110 - a few rounds
                    await asyncio.sleep(0)
                await asyncio.sleep(0)  # what goes out because of it is on its way
                in_flight.append(session.in_flight)

    assert in_flight == [3, 4, 3, 4, 3, 2, 1, 0]
