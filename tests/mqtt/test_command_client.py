"""The sender against brokers that misbehave; tests/end_to_end/commands/test_send.py has a real one."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import pytest

from gateway.errors import BrokerError, NoResultError
from gateway.mqtt.connection.command_client import CommandClient, Order
from gateway.mqtt.connection.settings import BrokerSettings
from gateway.mqtt.contract.topics import Topics
from tests.mqtt.fake_broker import ACCEPT_311, LEVEL_5, LEVEL_311, REFUSE_VERSION, FakeBroker, Packet

TOPICS = Topics("b")
ORDER = Order("pump-1", "alice", "start")


def publication(topic: str, payload: str, *, level: int = LEVEL_5) -> bytes:
    """Return a PUBLISH of QoS 0 as a broker sends it."""
    properties = b"\x00" if level == LEVEL_5 else b""
    body = len(topic).to_bytes(2, "big") + topic.encode() + properties + payload.encode()
    return bytes([0x30, len(body)]) + body


STATUS = publication(TOPICS.gateway_status, '{"state":"online","boot":"x"}')
FRESH = publication(TOPICS.gateway_fresh, '{"token":"t1","time":"2026Z"}')
NONSENSE = publication(TOPICS.gateway_status, "no json") + publication("b/other", "{}")


@dataclass
class PickyBroker(FakeBroker):
    """Answers each subscription with a code of its own."""

    suback_codes: list[int] = field(default_factory=list)

    async def _answer(self, packet: Packet, writer: asyncio.StreamWriter) -> bool:
        if packet.kind == 8 and self.suback_codes:
            self.suback_code = self.suback_codes.pop(0)
        return await super()._answer(packet, writer)


async def send(broker: FakeBroker, *, within_s: float = 10.0) -> Mapping[str, Any] | None:
    sender = CommandClient(BrokerSettings("127.0.0.1", broker.port, "mcc1"), TOPICS)
    return await sender.send(ORDER, now_s=1e9, within_s=within_s, on_phase=lambda _: None)


@pytest.mark.parametrize(
    ("codes", "forbidden"),
    [
        ([1, 0x87], "read b/gateway/status"),
        ([1, 1, 0x87], "read b/gateway/fresh"),
        ([0x87, 1, 1], "read the results of alice"),
    ],
)
async def test_a_refused_subscription_is_reported(codes: list[int], forbidden: str) -> None:
    async with PickyBroker(after_suback=STATUS + FRESH, suback_codes=codes) as broker:
        with pytest.raises(BrokerError, match=f"does not let a client without login {forbidden}"):
            await send(broker)


async def test_what_is_not_the_status_is_passed_over() -> None:
    async with FakeBroker(after_suback=NONSENSE + STATUS + FRESH) as broker:
        assert await send(broker, within_s=0.05) is None

        assert (await broker.publication()).topic == TOPICS.command("pump-1", "alice", "start")


async def test_a_broker_that_goes_away_meanwhile_leaves_the_end_unknown() -> None:
    async with FakeBroker(after_suback=STATUS + FRESH) as broker:
        sending = asyncio.create_task(send(broker))
        await broker.publication()

        broker._writers[-1].close()

        with pytest.raises(NoResultError, match="was lost before the final result: look at the starter"):
            await sending


async def test_a_broker_of_the_older_version_is_spoken_to_in_its_own() -> None:
    status = publication(TOPICS.gateway_status, '{"state":"online","boot":"x"}', level=LEVEL_311)
    fresh = publication(TOPICS.gateway_fresh, '{"token":"t1"}', level=LEVEL_311)
    answers: dict[int, bytes | None] = {LEVEL_5: REFUSE_VERSION, LEVEL_311: ACCEPT_311}
    async with FakeBroker(answers=answers, after_suback=status + fresh) as broker:
        assert await send(broker, within_s=0.05) is None

        assert broker.levels == [LEVEL_5, LEVEL_311]


async def test_a_broker_that_refuses_us_is_reported() -> None:
    async with FakeBroker(answers={LEVEL_5: bytes.fromhex("20 03 00 87 00")}) as broker:
        with pytest.raises(BrokerError):
            await send(broker)
