"""The service in virtual time: what goes out, when, and what the broker is made to forget."""

from __future__ import annotations

import asyncio
import json
import logging
from collections.abc import Callable, Coroutine, Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from gateway.app.integrations.home_assistant import HomeAssistantService, is_wanted
from gateway.app.integrations.integration import Integration, IntegrationHost, IntegrationService, Load
from gateway.app.site import Site
from gateway.config.schema import Config
from gateway.errors import DamagedError, StoreError
from gateway.home_assistant.announcements import Announcements
from gateway.mqtt.contract.payloads import Message, Payloads
from gateway.mqtt.contract.topics import Topics
from gateway.mqtt.outbox.outbox import Outbox
from gateway.mqtt.publisher import Publisher
from gateway.records import InfoRecord
from gateway.system.clock import SystemClock
from tests.home_assistant.announced import STARTERS, TABLE, config, info_messages
from tests.virtual_time import VirtualClock, run_virtually

OWN = "homeassistant/device/sg_mcc1/config"
TOPICS = {OWN, *(f"homeassistant/device/sg_mcc1_{name}/config" for name in STARTERS)}
OFF = ""


class Disk:
    """A file in memory that fails on order."""

    def __init__(self) -> None:
        self.document: Mapping[str, Any] | None = None
        self.is_full = self.is_damaged = self.is_set_aside = self.is_in_thread = False
        self.saves = 0

    def load(self) -> Mapping[str, Any] | None:
        assert self.is_in_thread, "the disk is read on the loop"
        if self.is_damaged:
            raise DamagedError("it is damaged")
        return self.document

    def set_aside(self) -> None:
        assert self.is_in_thread, "the disk is written on the loop"
        self.is_set_aside = True

    async def save(self, document: Mapping[str, Any]) -> None:
        if self.is_full:
            raise StoreError("the disk is full")
        self.saves += 1
        self.document = json.loads(json.dumps(document))


class Run:
    """One run of a gateway that is nothing but its publisher; its broker retains what it is sent."""

    def __init__(self, disk: Disk, broker: dict[str, bytes], table: str = TABLE, **options: Any) -> None:
        self.disk, self.broker = disk, broker
        self.sent: list[tuple[str, bool]] = []  # topic of discovery, and whether it has a payload
        self.listeners: dict[str, Callable[[bytes], None]] = {}
        clock = VirtualClock(asyncio.get_running_loop())
        self._site = config(table, **options)
        payloads = Payloads(Topics(self._site.base), "run-1")
        self.outbox = Outbox(last_topic=payloads.topics.gateway_status, pack=payloads.history)
        self.publisher = Publisher(payloads, self.outbox, clock)
        self.publisher.wake_with(self.deliver)
        self.connect()
        self._know(self._site)
        self.service = HomeAssistantService(
            site_of(self._site),
            announcer=self.publisher,
            uplink=cast("Any", self),
            clock=clock,
            seed=1,
            store=disk,
            in_thread=self._read,
        )
        self._task = asyncio.create_task(self.service.run())

    async def _read(self, read: Callable[[], Announcements]) -> Announcements:
        """Stand for a thread; on the loop nothing may read the disk."""
        self.disk.is_in_thread = True
        try:
            return read()
        finally:
            self.disk.is_in_thread = False

    def connect(self) -> None:
        self.outbox.connected(1000)
        self.deliver()

    def deliver(self) -> None:
        while (outgoing := self.outbox.take()) is not None:
            message = outgoing.message
            if message.topic.startswith("homeassistant/"):
                self.sent.append((message.topic, bool(message.payload)))
                self.broker[message.topic] = message.payload
                if not message.payload:
                    del self.broker[message.topic]
            self.outbox.acked(outgoing.ticket, 0)

    def listen(self, topic: str, on_message: Callable[[bytes], None]) -> None:
        self.listeners[topic] = on_message

    def unlisten(self, topic: str) -> None:
        del self.listeners[topic]

    def take_sent(self) -> list[tuple[str, bool]]:
        sent, self.sent = self.sent, []
        return sent

    def reload(self, table: str = TABLE, **options: Any) -> None:
        self._site = config(table, **options)
        self._know(self._site)
        self.service.move(site_of(self._site))

    def identify(self, starter: str, firmware: str) -> None:
        """Have a starter's `info` published with what it says of itself."""
        message = info_messages(self._site)[starter]
        info = {**json.loads(message.payload), "firmware": firmware}
        self.publisher.announce(Message(message.topic, json.dumps(info).encode(), qos=1, retain=True))
        self.service.put(InfoRecord(starter, "ssw07", None, firmware, None, "hall", 1, {}, ()))

    async def end(self) -> None:
        self._task.cancel()
        await asyncio.gather(self._task, return_exceptions=True)

    def _know(self, site: Config) -> None:
        for message in info_messages(site).values():
            if self.publisher.retained(message.topic) is None:
                self.publisher.announce(message)


def site_of(table: Config) -> Site:
    return cast("Site", SimpleNamespace(config=table, state_dir=Path("/nowhere")))


def play(scenario: Callable[[Disk, dict[str, bytes]], Coroutine[Any, Any, None]]) -> None:
    run_virtually(scenario(Disk(), {}))


def test_what_was_to_be_deleted_while_the_broker_was_away_is_deleted_when_it_is_back() -> None:
    async def scenario(disk: Disk, broker: dict[str, bytes]) -> None:
        run = Run(disk, broker)
        await asyncio.sleep(10)
        run.outbox.disconnected()
        run.reload(OFF)
        await asyncio.sleep(600)
        assert set(broker) == TOPICS
        assert disk.document == {"topics": sorted(TOPICS)}  # a crash now loses nothing
        run.connect()
        await asyncio.sleep(5)
        assert broker == {}
        assert disk.document == {"topics": []}
        await run.end()

    play(scenario)


@pytest.mark.parametrize("fault", ["is_full", "is_damaged"])
def test_a_disk_that_fails_hinders_no_announcement(fault: str, caplog: pytest.LogCaptureFixture) -> None:
    async def scenario(disk: Disk, broker: dict[str, bytes]) -> None:
        setattr(disk, fault, True)
        run = Run(disk, broker)
        await asyncio.sleep(10)
        assert set(broker) == TOPICS
        assert disk.is_set_aside == (fault == "is_damaged")
        await run.end()

    with caplog.at_level(logging.WARNING):
        play(scenario)
    assert "Home Assistant" in caplog.text


def test_what_is_announced_is_stored_before_it_goes_out() -> None:
    async def scenario(disk: Disk, broker: dict[str, bytes]) -> None:
        run = Run(disk, broker)
        seen: list[bool] = []
        deliver = run.deliver
        run.publisher.wake_with(lambda: seen.append(disk.saves > 0) or deliver())  # type: ignore[func-returns-value]
        await asyncio.sleep(10)
        assert seen == [True] * len(TOPICS)
        await run.end()

    play(scenario)


def test_it_runs_while_there_is_something_to_announce_or_to_delete(tmp_path: Path) -> None:
    def wanted(table: str) -> bool:
        return is_wanted(cast("Site", SimpleNamespace(config=config(table), state_dir=tmp_path)))

    assert (wanted(TABLE), wanted(OFF)) == (True, False)
    (tmp_path / "home-assistant.json").touch()
    assert wanted(OFF)


def test_a_bug_in_it_ends_it_alone_and_it_announces_anew(caplog: pytest.LogCaptureFixture) -> None:
    async def scenario(disk: Disk, broker: dict[str, bytes]) -> None:
        run = Run(disk, broker)
        await run.end()
        broker.clear()
        orders = ["ordered"]

        class Announcer:
            retained = run.publisher.retained

            def announce(self, message: Message) -> None:
                if orders:
                    raise ValueError(orders.pop())
                run.publisher.announce(message)

        def make(site: Site) -> HomeAssistantService:
            clock = VirtualClock(asyncio.get_running_loop())
            return HomeAssistantService(
                site,
                announcer=Announcer(),
                uplink=cast("Any", run),
                clock=clock,
                seed=1,
                store=disk,
                in_thread=run._read,
            )

        async def at_once(load: Load) -> Callable[[Site], IntegrationService]:
            return load()

        integration = Integration(
            "home-assistant",
            IntegrationHost(
                site_of(config()), SystemClock(), lambda: True, lambda *_: None, in_thread=at_once
            ),
            is_wanted=lambda _: True,
            load=lambda: make,
            missing="",
        )
        task = asyncio.create_task(integration.run())
        await asyncio.sleep(0.5)
        assert broker == {}
        await asyncio.sleep(5)
        assert set(broker) == TOPICS
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)

    play(scenario)
    assert "integration=home-assistant ended by a bug" in caplog.text
