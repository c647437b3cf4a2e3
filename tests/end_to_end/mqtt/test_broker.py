"""The connection against brokers that misbehave, on loopback and in real time."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from gateway.mqtt.connection.reconnect import Version, taken_over
from gateway.mqtt.connection.settings import TlsSettings
from gateway.records import LineRecord, Phase, ResultRecord
from tests.mosquitto import Certificate
from tests.mqtt.fake_broker import (
    ACCEPT_5,
    ACCEPT_311,
    HANG_UP,
    LEVEL_5,
    LEVEL_311,
    REFUSE_VERSION,
    FakeBroker,
)
from tests.mqtt.rig import MqttRig, event, settings, value


@pytest.mark.parametrize(
    ("answer", "levels"),
    [(REFUSE_VERSION, [LEVEL_5, LEVEL_311]), (HANG_UP, [LEVEL_5, LEVEL_5, LEVEL_311])],
)
async def test_a_broker_that_does_not_take_mqtt_5_is_spoken_to_in_3_1_1(
    answer: bytes, levels: list[int]
) -> None:
    async with (
        FakeBroker(answers={LEVEL_5: answer, LEVEL_311: ACCEPT_311}) as broker,
        MqttRig(settings(broker.port)) as rig,
    ):
        assert await rig.link() == (True, "")
        assert rig.links.empty()
        assert broker.levels == levels
        assert rig.versions == [Version.V311]


async def test_a_broker_that_stands_still_is_not_taken_for_an_older_one() -> None:
    async with (
        FakeBroker(answers={LEVEL_5: None, LEVEL_311: ACCEPT_311}) as broker,
        MqttRig(settings(broker.port, answer_s=0.1)) as rig,
    ):
        is_connected, trouble = await rig.link()
        while len(broker.levels) < 4:
            await rig.connection._pause(0.05)
        broker.answers[LEVEL_5] = ACCEPT_5
        await rig.until_connected()

    assert not is_connected
    assert trouble.endswith("sent no CONNACK within 0.1 s")
    assert set(broker.levels) == {LEVEL_5}
    assert rig.versions == [Version.V5]


async def test_mqtt_5_is_tried_again_at_each_connect() -> None:
    async with (
        FakeBroker(answers={LEVEL_5: REFUSE_VERSION, LEVEL_311: ACCEPT_311}) as broker,
        MqttRig(settings(broker.port)) as rig,
    ):
        await rig.until_connected()
        broker._writers[-1].close()
        await rig.until_connected()
        broker.answers[LEVEL_5] = ACCEPT_5
        broker._writers[-1].close()
        await rig.until_connected()

    assert broker.levels == [LEVEL_5, LEVEL_311, LEVEL_5, LEVEL_311, LEVEL_5]
    assert rig.versions == [Version.V311, Version.V311, Version.V5]


async def test_the_first_word_of_a_connection_is_the_proof_of_freshness_and_it_is_renewed_each_second() -> (
    None
):
    async with FakeBroker() as broker, MqttRig(settings(broker.port)) as rig:
        begun_s = asyncio.get_running_loop().time()
        seen = [await broker.publication(qos=0)]
        while [each.topic for each in seen].count("b/gateway/fresh") < 3:
            seen.append(await broker.publication(qos=0))
        took_s = asyncio.get_running_loop().time() - begun_s
        broker._writers[-1].close()
        await rig.until_connected()
        again = await broker.publication(qos=0)

    assert seen[0].topic == again.topic == "b/gateway/fresh"
    assert seen[1].topic == "b/gateway/status"
    assert 1.5 < took_s < 3.5
    assert len({each.body for each in (*seen, again) if each.topic == "b/gateway/fresh"}) == 4


async def test_a_configured_version_is_not_given_up() -> None:
    async with (
        FakeBroker(answers={LEVEL_5: REFUSE_VERSION}) as broker,
        MqttRig(settings(broker.port, version=Version.V5)) as rig,
    ):
        is_connected, trouble = await rig.link()

    assert not is_connected
    assert trouble == (
        f"broker 127.0.0.1:{broker.port} refuses the connection: Unsupported protocol version "
        "(set the version of MQTT that the broker supports)"
    )


async def test_no_more_messages_are_unacknowledged_than_the_broker_receives() -> None:
    receive_maximum_1 = bytes.fromhex("20 06 00 00 03 21 00 01")
    async with FakeBroker(answers={LEVEL_5: receive_maximum_1}, acknowledges=False) as broker:
        rig = MqttRig(settings(broker.port))
        for seq in range(1, 4):
            rig.publisher.put(event(seq))
        async with rig:
            first = await broker.publication()
            assert first.topic == "b/gateway/status"
            for _ in range(3):
                assert broker.received.empty()
                broker.acknowledge(first)
                first = await broker.publication()
            assert first.body.endswith(b'"text":"event 3","data":{}}')


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


async def test_a_broker_that_acknowledges_nothing_is_left_and_receives_everything_again() -> None:
    async with FakeBroker(acknowledges=False) as broker, MqttRig(settings(broker.port, ack_s=0.1)) as rig:
        rig.publisher.put(event(1))
        await rig.until_connected()
        is_connected, trouble = await rig.link()
        broker.acknowledges = True
        await rig.until_connected()
        await rig.until_idle()

    assert not is_connected
    assert trouble.endswith("the broker has not acknowledged a message for 0.1 s")
    assert rig.outbox.statistics(0.0)["reconnects"] == 1


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


async def test_a_refused_subscription_is_reported_and_telemetry_goes_out() -> None:
    async with FakeBroker(suback_code=0x87) as broker, MqttRig(settings(broker.port)) as rig:
        is_connected, trouble = await rig.link()
        await broker.publication()

    assert is_connected
    assert trouble == (
        f"broker 127.0.0.1:{broker.port} refuses commands: no subscription to b/command/# "
        "(let this user read it, in the broker's access list)"
    )


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


async def test_the_correlation_data_of_a_command_comes_back_with_its_result() -> None:
    async with FakeBroker() as broker, MqttRig(settings(broker.port)) as rig:
        rig.publisher.put(
            ResultRecord(
                *("pump-1", "alice", "c1", "read", Phase.CONFIRMED, "ok", "", 0.0), correlation=b"42"
            )
        )
        while (packet := await broker.publication()).topic != "b/result/pump-1/alice":
            pass

    assert b"\x05\x09\x00\x0242{" in packet.body


async def test_statistics_go_out_without_waiting_for_an_acknowledgement() -> None:
    async with FakeBroker(acknowledges=False) as broker, MqttRig(settings(broker.port)) as rig:
        rig.publisher.put(LineRecord("pumps", {"polls": 1}))
        while (await broker.publication(qos=0)).topic != "b/gateway/line/pumps":
            pass
        await rig.until_connected()
        session = rig.connection._session
        assert session is not None
        assert len(session._tickets) == 1  # the status


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
