from __future__ import annotations

import asyncio
import json
import logging
from typing import Any

import pytest

from gateway.mqtt.contract.payloads import Payloads
from gateway.mqtt.contract.topics import Topics
from gateway.mqtt.outbox.outbox import Outbox
from gateway.mqtt.publisher import Publisher
from gateway.records import EventRecord, LineRecord, Quality, Severity, ValueRecord
from tests.virtual_time import VirtualClock, run_virtually


def value(seq: int, number: float, *, point: str = "current") -> ValueRecord:
    return ValueRecord("pump-1", point, number, "A", Quality.GOOD, 1_760_000_000.0 + seq, seq)


def event(seq: int) -> EventRecord:
    return EventRecord("pump-1", "started", Severity.INFO, f"event {seq}", 1_760_000_000.0 + seq, seq)


class Desk:
    """A publisher whose broker takes everything at once."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        payloads = Payloads(Topics("b"), "boot-1")
        self.outbox = Outbox(last_topic=payloads.topics.gateway_status, pack=payloads.history, boot="boot-1")
        self.publisher = Publisher(payloads, self.outbox, VirtualClock(loop))
        self.outbox.connected(1000)
        self.wakes = 0
        self.publisher.wake_with(self._wake)

    def published(self) -> list[tuple[str, Any]]:
        """Return topic and payload of what was published since the last call."""
        messages = []
        while (outgoing := self.outbox.take()) is not None:
            self.outbox.acked(outgoing.ticket, 0)
            payload = outgoing.message.payload
            messages.append((outgoing.message.topic, json.loads(payload) if payload else None))
        return messages

    def _wake(self) -> None:
        self.wakes += 1


async def desk() -> Desk:
    made = Desk(asyncio.get_running_loop())
    made.published()
    return made


def test_the_newest_values_are_those_of_its_messages_until_a_starter_is_forgotten() -> None:
    async def main() -> None:
        made = await desk()
        made.publisher.put(value(1, 1.0))
        made.publisher.put(value(2, 2.0))
        made.published()
        assert list(made.publisher.values()) == [value(2, 2.0)]

        made.publisher.forget(value(2, 2.0).starter)
        assert list(made.publisher.values()) == []

    run_virtually(main())


def test_a_record_that_cannot_be_published_is_logged_and_harms_nothing(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async def main() -> None:
        made = await desk()

        made.publisher.put(LineRecord("Pump Hall", {}))
        made.publisher.put(value(1, 1.0))

        assert [topic for topic, _ in made.published()] == ["b/starter/pump-1/value/current"]

    run_virtually(main())
    assert caplog.messages == ["record=LineRecord cannot be published"]


async def statistics_over(made: Desk, seconds: int) -> list[tuple[int, Any]]:
    """Return at which second the outbox statistics were published, and the statistics."""
    seen = []
    for second in range(seconds):
        seen += [(second, payload) for topic, payload in made.published() if topic == "b/gateway/outbox"]
        await asyncio.sleep(1.0)
    return seen


def test_a_full_outbox_is_reported_within_a_second_and_logged_once(caplog: pytest.LogCaptureFixture) -> None:
    async def main() -> list[tuple[int, Any]]:
        made = await desk()
        made.outbox.backlog._max_rows = 1
        task = asyncio.create_task(made.publisher.run())
        await asyncio.sleep(0.5)
        made.published()
        for seq in range(1, 4):
            made.publisher.put(event(seq))
        await asyncio.sleep(1.0)
        seen = await statistics_over(made, 1)
        task.cancel()
        return seen

    with caplog.at_level(logging.WARNING):
        seen = run_virtually(main())
    assert [payload["dropped"] for _, payload in seen] == [2]
    assert caplog.messages == ["outbox full: the oldest history, events and audit records are dropped"]
