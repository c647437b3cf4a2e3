from __future__ import annotations

import asyncio
import json
import logging
from typing import Any

import pytest

from gateway.mqtt.contract.payloads import GatewayInfo, Payloads
from gateway.mqtt.contract.topics import Topics
from gateway.mqtt.outbox.outbox import Outbox
from gateway.mqtt.publisher import Publisher
from gateway.records import LineRecord, Sink
from tests.mqtt.rig import event, value
from tests.virtual_time import EPOCH_S, VirtualClock, run_virtually


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


def test_the_gateway_begins_as_starting() -> None:
    async def main() -> None:
        made = Desk(asyncio.get_running_loop())
        assert [(topic, payload["state"]) for topic, payload in made.published()] == [
            ("b/gateway/status", "starting")
        ]

    run_virtually(main())


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


def test_a_record_is_put_into_the_outbox_and_the_sender_woken() -> None:
    async def main() -> None:
        made = await desk()
        sink: Sink = made.publisher

        sink.put(event(1))

        assert [topic for topic, _ in made.published()] == ["b/starter/pump-1/event"]
        assert made.wakes == 1

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


def test_the_status_is_published_when_it_changes_and_remembers_since_when() -> None:
    async def main() -> list[tuple[str, Any]]:
        made = await desk()
        for state, reason in [
            ("online", None),
            ("online", None),
            ("degraded", "line pumps: no port"),
            ("degraded", "line fans: no port"),
        ]:
            await asyncio.sleep(1.0)
            made.publisher.set_status(state, reason)
        return made.published()

    ((topic, status),) = run_virtually(main())
    assert topic == "b/gateway/status"
    assert status == {
        "state": "degraded",
        "time": "2025-10-09T08:53:24.000Z",
        "boot": "boot-1",
        "since": "2025-10-09T08:53:23.000Z",
        "reason": "line fans: no port",
        "run": "boot-1",
    }


def test_an_unchanged_status_is_not_published_again() -> None:
    async def main() -> None:
        made = await desk()
        made.publisher.set_status("online")
        made.published()

        made.publisher.set_status("online")

        assert made.published() == []

    run_virtually(main())


def test_the_info_is_published() -> None:
    async def main() -> None:
        made = await desk()

        made.publisher.set_info(GatewayInfo("0.1.0", ("pump-1",), ("pumps",), ()))

        assert [topic for topic, _ in made.published()] == ["b/gateway/info"]

    run_virtually(main())


def test_a_forgotten_starter_is_cleared() -> None:
    async def main() -> None:
        made = await desk()
        made.publisher.put(value(1, 1.0))
        made.published()

        made.publisher.forget("pump-1")

        assert made.published() == [("b/starter/pump-1/value/current", None)]
        assert made.wakes == 2

    run_virtually(main())


def test_the_will_and_the_farewell_say_offline() -> None:
    async def main() -> None:
        publisher = (await desk()).publisher

        will = publisher.will()
        farewell = publisher.farewell("SIGTERM")

        assert json.loads(will.payload)["state"] == "offline"
        assert json.loads(will.payload)["time"] is None
        assert json.loads(farewell.payload) == {
            "state": "offline",
            "time": "2025-10-09T08:53:20.000Z",
            "boot": "boot-1",
            "since": "2025-10-09T08:53:20.000Z",
            "reason": "SIGTERM",
            "run": "boot-1",
        }
        assert will.topic == farewell.topic == "b/gateway/status"

    run_virtually(main())
    assert EPOCH_S == 1_760_000_000.0


async def statistics_over(made: Desk, seconds: int) -> list[tuple[int, Any]]:
    """Return at which second the outbox statistics were published, and the statistics."""
    seen = []
    for second in range(seconds):
        seen += [(second, payload) for topic, payload in made.published() if topic == "b/gateway/outbox"]
        await asyncio.sleep(1.0)
    return seen


def test_the_outbox_statistics_come_every_30_s() -> None:
    async def main() -> list[tuple[int, Any]]:
        made = await desk()
        task = asyncio.create_task(made.publisher.run())
        await asyncio.sleep(0.5)
        seen = await statistics_over(made, 70)
        task.cancel()
        return seen

    assert [second for second, _ in run_virtually(main())] == [0, 30, 60]


def test_a_refusal_is_reported_within_a_second_and_logged_once(caplog: pytest.LogCaptureFixture) -> None:
    async def main() -> list[tuple[int, Any]]:
        made = await desk()
        task = asyncio.create_task(made.publisher.run())
        await asyncio.sleep(0.5)
        made.published()
        for _ in range(2):
            made.publisher.put(event(1))
            outgoing = made.outbox.take()
            assert outgoing is not None
            made.outbox.acked(outgoing.ticket, 0x87)
            await asyncio.sleep(2.0)
        seen = await statistics_over(made, 1)
        task.cancel()
        return seen

    with caplog.at_level(logging.WARNING):
        seen = run_virtually(main())
    assert seen[-1][1]["refused"] == 2
    assert caplog.messages == [
        "topic=b/starter/pump-1/event refused by the broker, reason code 0x87; check its access list"
    ]


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
