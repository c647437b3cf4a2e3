"""The way up moves to another broker: goodbye there, everything afresh here, nothing kept is lost."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from gateway.app.site import Site
from gateway.app.uplink import Uplink
from gateway.config.load import parse
from gateway.mqtt.contract.commands import Incoming
from gateway.mqtt.contract.freshness import Tokens
from gateway.mqtt.contract.run_token import RunToken
from gateway.records import AvailabilityRecord
from gateway.system.clock import SystemClock
from tests.mosquitto import MosquittoBroker, StartMosquitto, Watcher
from tests.mqtt.fake_broker import ACCEPT_5, ACCEPT_311, LEVEL_5, LEVEL_311, REFUSE_VERSION, FakeBroker

CONFIG = (
    '[gateway]\nname = "g"\nstate_dir = "state"\n[mqtt]\nurl = "mqtt://127.0.0.1:{port}"\n{more}\n'
    '[[line]]\nname = "l"\nport = "/dev/x"\nbaud = 9600\nframing = "8N2"\n'
    '[[line.starter]]\nname = "pump"\naddress = 1\nfamily = "ssw07"\n'
)
NOBODY = 9


def site(folder: Path, port: int, *, more: str = "", password: str | None = None) -> Site:
    config = parse(CONFIG.format(port=port, more=more), "site.toml")
    return Site.of(config, folder=folder, password=password)


class Links:
    """Hears of the connection."""

    def __init__(self) -> None:
        self.told: asyncio.Queue[tuple[bool, str]] = asyncio.Queue()

    def note(self, is_connected: bool, trouble: str) -> None:
        self.told.put_nowait((is_connected, trouble))

    async def next(self) -> tuple[bool, str]:
        async with asyncio.timeout(10.0):
            return await self.told.get()


@asynccontextmanager
async def uplink(
    first: Site, events: list[tuple[str, str]] | None = None
) -> AsyncIterator[tuple[Uplink, Links]]:
    links = Links()
    incoming: list[Incoming] = []
    up = Uplink(
        first,
        Tokens(RunToken("run")),
        clock=SystemClock(),
        on_incoming=incoming.append,
        on_link=links.note,
        tell=lambda code, _severity, text, _data: (events if events is not None else []).append((code, text)),
    )
    running = asyncio.create_task(up.run())
    yield up, links
    await up.close("over")
    running.cancel()
    await asyncio.wait((running,))


async def statuses(watcher: Watcher, *wanted: str) -> None:
    """Wait until the gateway's status was each of these, one after the other."""
    for state in wanted:
        await watcher.until(
            lambda seen, state=state: (
                seen.topic.endswith("gateway/status") and json.loads(seen.payload)["state"] == state
            )
        )


def watch(broker: MosquittoBroker) -> Watcher:
    return broker.watch("starters/g/#")


async def test_goodbye_is_said_to_the_old_broker_and_everything_retained_to_the_new_one(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    old, new = start_mosquitto(), start_mosquitto()
    async with (
        watch(old) as before,
        watch(new) as after,
        uplink(site(tmp_path, old.port)) as (up, links),
    ):
        up.publisher.put(AvailabilityRecord("pump", "online", 1.0, None))
        up.publisher.set_status("online")
        assert await links.next() == (True, "")
        await statuses(before, "online")

        await up.move(site(tmp_path, new.port))

        is_connected, trouble = await links.next()
        assert not is_connected
        assert f"moving to broker 127.0.0.1:{new.port}" in trouble
        assert await links.next() == (True, "")
        await statuses(before, "offline")
        seen = await after.until(lambda each: each.topic.endswith("gateway/status"))
        assert "starters/g/starter/pump/availability" in [each.topic for each in seen]


async def test_nothing_moves_when_broker_and_login_are_the_same(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    broker = start_mosquitto()
    async with uplink(site(tmp_path, broker.port)) as (up, links):
        assert await links.next() == (True, "")

        await up.move(site(tmp_path, broker.port))

        assert links.told.empty()


async def test_another_password_alone_is_another_login(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    broker = start_mosquitto(users={"g": "right"})
    more = 'username = "g"'
    async with uplink(site(tmp_path, broker.port, more=more, password="wrong")) as (up, links):
        is_connected, _ = await links.next()
        assert not is_connected

        await up.move(site(tmp_path, broker.port, more=more, password="right"))

        while not (await links.next())[0]:
            pass


async def test_a_broker_that_was_never_there_is_left_at_once(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    broker = start_mosquitto()
    async with uplink(site(tmp_path, NOBODY)) as (up, links):
        assert not (await links.next())[0]

        async with asyncio.timeout(2.0):
            await up.move(site(tmp_path, broker.port))

        while not (await links.next())[0]:
            pass


async def test_the_version_of_mqtt_is_published_and_the_older_one_warned_of(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    events: list[tuple[str, str]] = []
    answers: dict[int, bytes | None] = {LEVEL_5: REFUSE_VERSION, LEVEL_311: ACCEPT_311}
    async with (
        FakeBroker(answers=answers) as broker,
        uplink(site(tmp_path, broker.port), events) as (_, links),
    ):
        old = await info(broker)
        broker.answers[LEVEL_5] = ACCEPT_5
        assert await links.next() == (True, "")
        broker.hang_up()
        new = await info(broker)

    assert (old["mqtt_version"], new["mqtt_version"]) == ("3.1.1", "5")
    assert [code for code, _ in events] == ["mqtt_3_1_1", "mqtt_5"]
    assert "Lost: the retained flag of commands that are delivered live" in events[0][1]
    assert "the broker refuses MQTT 5" in events[0][1]


async def info(broker: FakeBroker) -> dict[str, Any]:
    """Return the next gateway/info that knows its version."""
    while True:
        packet = await broker.publication()
        if packet.topic == "starters/g/gateway/info":
            fields: dict[str, Any] = json.loads(packet.body[packet.body.index(b"{") :])
            if fields["mqtt_version"] is not None:
                return fields
