"""The connection of the edge node, in virtual time, against a link that does as ordered."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from contextlib import suppress
from dataclasses import replace
from typing import Any

import pytest

from gateway.errors import BrokerError, DamagedError, StoreError
from gateway.mqtt.connection.reconnect import Version
from gateway.mqtt.connection.session import SessionParts
from gateway.mqtt.connection.settings import BrokerSettings
from gateway.mqtt.contract.commands import Incoming, Rejection
from gateway.mqtt.contract.payloads import Message
from gateway.mqtt.contract.topics import Topics
from gateway.records import Record
from gateway.sparkplug import service
from gateway.sparkplug.payload import HostCommand, decoded_command
from gateway.sparkplug.service import SparkplugLink, SparkplugParts, sparkplug_link
from gateway.sparkplug.settings import SparkplugSettings
from gateway.starters.policy.rights import Operator
from tests.sparkplug.support import (
    FACTS,
    PROPERTIES,
    NodeMessage,
    availability,
    dcmd,
    host_says,
    info,
    read,
    value,
    write,
)
from tests.virtual_time import VirtualClock, run_virtually

NCMD, DCMD = "spBv1.0/plant/NCMD/mcc1", "spBv1.0/plant/DCMD/mcc1/pump"
STATE = "spBv1.0/STATE/scada"
REBIRTH = {"name": "Node Control/Rebirth", "boolean_value": True}


class Store:
    """A disk that fails on order."""

    def __init__(self, document: dict[str, Any] | None = None) -> None:
        self.document = document
        self.is_full = self.is_damaged = self.is_aside = False

    def load(self) -> dict[str, Any] | None:
        if self.is_damaged:
            raise DamagedError("bdseq.json is damaged")
        return self.document

    def set_aside(self) -> None:
        self.is_aside = True

    async def save(self, document: Any) -> None:
        await asyncio.sleep(0.01)
        if self.is_full:
            raise StoreError("no space")
        self.document = dict(document)


class FakeLink:
    """Implements `Link`."""

    def __init__(
        self,
        world: World,
        settings: BrokerSettings,
        version: Version,
        parts: SessionParts,
    ) -> None:
        assert parts.will is not None
        self.world = world
        self.settings, self.version = settings, version
        self.will, self.on_incoming, self.on_ack = read(parts.will), parts.on_incoming, parts.on_ack
        self.stored = dict(world.store.document or {})
        self.log: list[Any] = []
        self.lost: asyncio.Future[str] = asyncio.get_running_loop().create_future()
        self.connack_code: int | None = None
        self.is_closed_unanswered = False
        self.has_sent_all = True
        self.ways_out: list[str] = []

    async def connect(self) -> None:
        if self.world.is_away or self.settings.port in self.world.ports_away:
            raise BrokerError(f"broker {self.settings.address} cannot be reached")
        if self.version is Version.V5 and self.world.is_old:
            self.connack_code = 0x84
            raise BrokerError("unsupported version")

    async def subscribe(self, topic_filter: str, *, with_retained: bool = False) -> bool:
        self.log.append(("subscribe", topic_filter, with_retained))
        if topic_filter == STATE and self.settings.port in self.world.host_at:
            self.get(STATE, host_says(True, 1000))
        return topic_filter not in self.world.refused

    def publish(self, ticket: int, message: Message) -> int | None:
        if len(message.payload) > self.world.most_bytes:
            return 0x95
        self.log.append(read(message))
        if message.qos:
            asyncio.get_running_loop().call_soon(self.on_ack, ticket, 0)
        return None

    async def disconnect(self, *, with_will: bool = False) -> None:
        self.ways_out.append("with will" if with_will else "disconnect")

    def abort(self) -> None:
        self.ways_out.append("abort")

    def get(self, topic: str, payload: bytes, *, is_retained: bool = False) -> None:
        self.on_incoming(Incoming(topic, payload, is_retained=is_retained))

    @property
    def said(self) -> list[NodeMessage]:
        return [each for each in self.log if isinstance(each, NodeMessage)]

    @property
    def kinds(self) -> list[str]:
        return [each.kind for each in self.said]


async def _at_once(read_: Callable[[], int]) -> int:
    return read_()


class World:
    """One service with its links; `settings` are changes to the usual ones."""

    def __init__(self, *, servers: int = 1, past: tuple[Record, ...] = (), **settings: Any) -> None:
        self.clock = VirtualClock(asyncio.get_running_loop())
        self.store = Store()
        self.links: list[FakeLink] = []
        self.is_away = self.is_old = False
        self.ports_away: set[int] = set()
        self.host_at: set[int] = set()
        self.refused: set[str] = set()
        self.most_bytes = 10**9
        self.taken: list[Incoming] = []
        self.rejected: list[Rejection] = []
        self.events: list[tuple[str, str]] = []
        self.facts: dict[str, Any] = dict(FACTS)
        brokers = tuple(BrokerSettings("localhost", 1883 + each, "mcc1-spb") for each in range(servers))
        rights = (Operator("ops", ("*",), ("*",)),)
        self.settings = replace(SparkplugSettings("plant", "mcc1", brokers, rights=rights), **settings)
        self.past = past
        self.service = self._made()
        self.serving = asyncio.create_task(self.service.run())

    def _made(self) -> SparkplugLink:
        return sparkplug_link(
            self.settings,
            SparkplugParts(
                latest=lambda: self.past,
                clock=self.clock,
                take=self.taken.append,
                reject=self.rejected.append,
                facts=lambda: self.facts,
                since_s=self.clock.utc_s(),
                publish_event=lambda code, _severity, text, *_: self.events.append((code, text)),
            ),
            topics=Topics("starters/mcc1"),
            starters=("pump", "fan"),
            lines=("hall",),
            properties=PROPERTIES,
            store=self.store,
            make_link=self._make_link,
            in_thread=_at_once,
        )

    def _make_link(self, settings: BrokerSettings, version: Version, parts: SessionParts) -> FakeLink:
        self.links.append(FakeLink(self, settings, version, parts))
        return self.links[-1]

    @property
    def link(self) -> FakeLink:
        return self.links[-1]

    def online(self, *starters: str) -> None:
        for starter in starters or ("pump", "fan"):
            self.service.put(info(starter))
            self.service.put(availability(starter, "online", self.clock.utc_s()))

    async def end(self) -> None:
        self.serving.cancel()
        with suppress(asyncio.CancelledError):
            await self.serving

    async def again(self) -> None:
        """End, and begin as the next process does, with what is on the disk."""
        await self.end()
        self.service = self._made()
        self.serving = asyncio.create_task(self.service.run())


Scenario = Callable[[], Coroutine[Any, Any, None]]


def virtually(scenario: Scenario) -> Callable[[], None]:
    def test() -> None:
        run_virtually(scenario())

    test.__name__ = scenario.__name__
    return test


@virtually
async def test_the_number_is_on_the_disk_before_connect_and_in_the_will_and_the_birth() -> None:
    world = World()
    await asyncio.sleep(1.0)

    assert world.link.stored == {"bdSeq": 0}
    assert (world.link.will.kind, world.link.will.qos, world.link.will.retain) == ("NDEATH", 1, False)
    assert world.link.will.values == {"bdSeq": 0}
    assert world.link.said[0].values["bdSeq"] == 0
    await world.end()


@virtually
async def test_each_connection_has_the_next_number_also_after_a_restart_and_255_is_followed_by_0() -> None:
    world = World()
    world.store.document = {"bdSeq": 253}
    for _ in range(3):
        await asyncio.sleep(10.0)
        world.link.lost.set_result("cut")
    await asyncio.sleep(10.0)
    await world.again()
    await asyncio.sleep(10.0)

    assert [each.will.values["bdSeq"] for each in world.links] == [254, 255, 0, 1, 2]
    assert [each.stored["bdSeq"] for each in world.links] == [254, 255, 0, 1, 2]
    await world.end()


@virtually
async def test_a_damaged_number_begins_again_at_0_and_a_full_disk_stops_nothing() -> None:
    world = World()
    world.store.is_damaged = world.store.is_full = True
    await asyncio.sleep(1.0)
    world.link.lost.set_result("cut")
    await asyncio.sleep(5.0)

    assert world.store.is_aside
    assert [each.said[0].values["bdSeq"] for each in world.links] == [0, 1]
    assert [code for code, _ in world.events].count("memory_away") == 1
    await world.end()


@virtually
async def test_everything_is_subscribed_to_before_the_birth_which_is_the_first_message() -> None:
    world = World(operator="ops", primary_host="scada")
    world.host_at = {1883}
    await asyncio.sleep(1.0)

    assert world.link.log[:3] == [
        ("subscribe", NCMD, False),
        ("subscribe", "spBv1.0/plant/DCMD/mcc1/+", False),
        ("subscribe", STATE, True),
    ]
    assert world.link.kinds[0] == "NBIRTH"
    await world.end()


@virtually
async def test_without_commands_no_dcmd_is_subscribed_to_nor_named_nor_taken() -> None:
    world = World()
    world.online()
    await asyncio.sleep(1.0)

    world.link.get(DCMD, dcmd(write("Command/Stop"), time_s=world.clock.utc_s()))
    await asyncio.sleep(1.0)

    assert [each for each in world.link.log if isinstance(each, tuple)] == [("subscribe", NCMD, False)]
    assert not any("Command" in name for each in world.link.said for name in each.names)
    assert world.taken == []
    await world.end()


@virtually
async def test_what_was_recorded_before_is_in_the_births() -> None:
    past = (info("pump"), availability("pump", "online", 1.0), value("pump", "current", 7.5))
    world = World(past=past)
    await asyncio.sleep(1.0)

    assert world.link.kinds == ["NBIRTH", "DBIRTH"]
    assert world.link.said[1].values["current"] == 7.5
    await world.end()


@virtually
async def test_records_go_out_within_a_quarter_second_and_facts_within_five_seconds() -> None:
    world = World()
    world.online()
    await asyncio.sleep(1.0)
    begun = len(world.link.said)

    world.service.put(value("pump", "current", 1.0))
    await asyncio.sleep(0.001)
    assert world.link.kinds[begun:] == ["DDATA"]
    world.facts["outbox/depth"] = 5
    await asyncio.sleep(5.5)

    assert world.link.said[-1].values == {"outbox/depth": 5}
    await world.end()


@virtually
async def test_a_rebirth_needs_no_timestamp() -> None:
    world = World()
    await asyncio.sleep(1.0)

    world.link.get(NCMD, dcmd(REBIRTH, time_s=None))
    await asyncio.sleep(0.01)

    assert world.link.kinds == ["NBIRTH", "NBIRTH"]
    await world.end()


@virtually
async def test_a_rebirth_that_is_false_or_garbage_or_for_another_changes_nothing() -> None:
    world = World()
    await asyncio.sleep(1.0)

    world.link.get(NCMD, dcmd({"name": "Node Control/Rebirth", "boolean_value": False}))
    world.link.get(NCMD, dcmd({"name": "Node Control/Reboot", "boolean_value": True}))
    world.link.get(NCMD, b"\xff\xff\xff")
    world.link.get("spBv1.0/plant/NCMD/other", dcmd(REBIRTH))
    await asyncio.sleep(10.0)

    assert world.link.kinds == ["NBIRTH"]
    await world.end()


def test_of_a_flood_of_ncmds_only_some_are_decoded_and_a_later_one_is_honoured(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    run_virtually(_ncmd_flood(monkeypatch))


async def _ncmd_flood(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each takes most of a millisecond, and stops wait meanwhile."""
    world = World()
    await asyncio.sleep(1.0)
    decoded: list[bytes] = []

    def decode(payload: bytes) -> HostCommand:
        decoded.append(payload)
        return decoded_command(payload)

    monkeypatch.setattr(service, "decoded_command", decode)
    dear = b"\x12\x00" * 2000 + dcmd({"name": "Node Control/Rebirth", "boolean_value": False})
    for _ in range(1000):
        world.link.get(NCMD, dear)
    assert len(decoded) <= 10

    await asyncio.sleep(1.0)
    world.link.get(NCMD, dcmd(REBIRTH))
    await asyncio.sleep(0.01)
    assert world.link.kinds == ["NBIRTH", "NBIRTH"]
    await world.end()


@virtually
async def test_a_socket_that_takes_nothing_gets_no_number_and_later_the_newest_values() -> None:
    world = World()
    world.online()
    await asyncio.sleep(1.0)
    begun = len(world.link.said)
    world.link.has_sent_all = False
    for number in range(30):
        world.service.put(value("pump", "current", float(number)))
        await asyncio.sleep(0.3)
    assert world.link.kinds[begun:] == []

    world.link.has_sent_all = True
    await asyncio.sleep(1.0)

    data = world.link.said[begun]
    assert data.seq == world.link.said[begun - 1].seq + 1  # type: ignore[operator]
    assert [each["value"] for each in data.metrics] == [float(number) for number in range(30)]
    await world.end()


@virtually
async def test_a_broken_link_is_followed_by_new_births_also_after_ten_minutes_within_ten_seconds() -> None:
    world = World()
    world.online()
    await asyncio.sleep(60.0)
    world.is_away = True
    world.link.lost.set_result("cut")
    await asyncio.sleep(600.0)
    world.service.put(value("pump", "current", 42.0))
    world.is_away = False

    await asyncio.sleep(10.0)

    assert world.link.kinds == ["NBIRTH", "DBIRTH", "DBIRTH"]
    assert world.link.said[1].values["current"] == 42.0
    codes = [code for code, _ in world.events]
    assert codes == ["sparkplug_born", "sparkplug_away", "sparkplug_away", "sparkplug_born"]
    await world.end()


@virtually
async def test_an_orderly_end_publishes_the_death_before_it_disconnects_with_the_will() -> None:
    world = World()
    await asyncio.sleep(1.0)

    await world.end()

    assert world.link.kinds == ["NBIRTH", "NDEATH"]
    assert world.link.said[-1].values == {"bdSeq": 0}
    assert world.link.ways_out[0] == "with will"


@virtually
async def test_an_end_before_the_birth_leaves_the_death_to_the_will() -> None:
    world = World(primary_host="scada")
    await asyncio.sleep(1.0)

    await world.end()

    assert world.link.kinds == []
    assert world.link.ways_out == ["abort"]


@virtually
async def test_while_the_primary_host_is_away_nothing_is_published() -> None:
    world = World(primary_host="scada")
    world.online()
    await asyncio.sleep(100.0)
    assert (len(world.links), world.link.kinds) == (1, [])
    assert world.events[-1] == ("sparkplug_away", "Sparkplug: waits for the primary host scada")

    world.link.get(STATE, host_says(True, 1000))
    await asyncio.sleep(0.1)

    assert world.link.kinds == ["NBIRTH", "DBIRTH", "DBIRTH"]
    await world.end()


@virtually
async def test_when_the_primary_host_goes_the_node_dies_disconnects_and_waits_anew() -> None:
    world = World(primary_host="scada")
    await asyncio.sleep(1.0)
    world.link.get(STATE, host_says(True, 1000))
    await asyncio.sleep(1.0)

    world.link.get(STATE, host_says(False, 999))
    await asyncio.sleep(1.0)
    assert world.link.kinds == ["NBIRTH"]
    world.link.get(STATE, host_says(False, 2000))
    await asyncio.sleep(60.0)

    first, second = world.links
    assert first.kinds == ["NBIRTH", "NDEATH"]
    assert first.ways_out[0] == "with will"
    assert second.kinds == []
    second.get(STATE, host_says(True, 3000))
    await asyncio.sleep(1.0)
    assert second.kinds == ["NBIRTH"]
    assert second.said[0].values["bdSeq"] == 1
    await world.end()


@virtually
async def test_of_several_servers_the_one_with_the_primary_host_is_found_one_at_a_time() -> None:
    world = World(servers=3, primary_host="scada")
    world.host_at, world.ports_away = {1885}, {1884}
    await asyncio.sleep(30.0)

    assert [each.settings.port for each in world.links] == [1883, 1884, 1885]
    assert [each.kinds for each in world.links] == [[], [], ["NBIRTH"]]
    assert all(("subscribe", STATE, True) in each.log for each in (world.links[0], world.links[2]))
    assert all(each.ways_out for each in world.links[:2])  # ended before the next one begins

    world.host_at = {1883}
    world.link.get(STATE, host_says(False, 5000))
    await asyncio.sleep(30.0)

    assert [each.settings.port for each in world.links[3:]] == [1883]
    assert world.link.kinds == ["NBIRTH"]
    await world.end()


@virtually
async def test_mqtt_3_1_1_is_spoken_to_a_server_that_knows_no_other() -> None:
    world = World()
    world.is_old = True
    await asyncio.sleep(5.0)

    assert [each.version for each in world.links] == [Version.V5, Version.V311]
    assert world.link.kinds == ["NBIRTH"]
    await world.end()


@pytest.mark.parametrize("topic", [NCMD, "spBv1.0/plant/DCMD/mcc1/+", STATE])
def test_a_server_that_refuses_a_subscription_is_reported_and_nothing_is_born(topic: str) -> None:
    async def scenario() -> None:
        world = World(operator="ops", primary_host="scada")
        world.refused = {topic}
        await asyncio.sleep(30.0)

        assert all(each.kinds == [] for each in world.links)
        assert [code for code, _ in world.events] == ["sparkplug_away"]
        assert topic in world.events[0][1]
        await world.end()

    run_virtually(scenario())


@virtually
async def test_a_birth_that_is_too_large_for_the_server_is_reported() -> None:
    world = World()
    world.most_bytes = 10
    await asyncio.sleep(30.0)

    assert "takes no message of" in world.events[0][1]
    await world.end()


@virtually
async def test_a_write_is_handed_on_and_shown_as_false_again_at_once() -> None:
    world = World(operator="ops")
    world.online()
    await asyncio.sleep(3.0)
    begun = len(world.link.said)

    world.link.get(DCMD, dcmd(write("Command/Start"), write("Command/Other"), time_s=world.clock.utc_s()))
    await asyncio.sleep(0.3)

    assert [each.topic for each in world.taken] == ["starters/mcc1/command/pump/ops/start"]
    assert [each.code for each in world.rejected] == ["unknown_verb"]
    assert [each.values for each in world.link.said[begun:]] == [{"Command/Start": False}]
    await world.end()


@virtually
async def test_a_start_that_arrives_before_the_birth_is_refused_and_a_stop_is_not() -> None:
    world = World(operator="ops", primary_host="scada")
    world.online()
    await asyncio.sleep(1.0)

    world.link.get(DCMD, dcmd(write("Command/Start"), write("Command/Stop"), time_s=world.clock.utc_s()))

    assert [each.topic.rpartition("/")[2] for each in world.taken] == ["stop"]
    assert [each.code for each in world.rejected] == ["before_connection"]
    await world.end()


@virtually
async def test_writes_to_what_is_no_starter_are_an_event_once_a_second_and_nothing_else() -> None:
    world = World(operator="ops")
    await asyncio.sleep(1.0)
    begun = len(world.events)

    for count in range(50):
        world.link.get(f"spBv1.0/plant/DCMD/mcc1/nothing{count}\x1b", dcmd(write("Command/Stop")))
    await asyncio.sleep(2.0)

    assert (world.taken, world.rejected) == ([], [])
    assert world.events[begun:] == [
        ("dcmd_refused", "nothing0?: a DCMD refused: this gateway has no such starter"),
        ("dcmd_refused", "nothing49?: 49 more DCMDs refused: this gateway has no such starter"),
    ]
    await world.end()


@virtually
async def test_a_bug_in_taking_one_message_does_not_hide_the_next_one() -> None:
    world = World(operator="ops")
    await asyncio.sleep(1.0)
    host_commands = world.service._host_commands
    assert host_commands is not None
    good, host_commands._take = host_commands._take, lambda _: [][1]
    world.link.get(DCMD, dcmd(write("Command/Stop")))
    host_commands._take = good

    world.link.get(DCMD, dcmd(write("Command/Stop")))

    assert len(world.taken) == 1
    await world.end()
