"""A flood of messages delays no stop: what is parsed before one is looked for is bounded."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field

from gateway.contract import Topics
from gateway.mqtt.commands import Incoming
from gateway.mqtt.connection.inbox import MOST, MOST_OF_CLIENT, PARSED_STOPS, SHARE, Inbox
from tests.virtual_time import VirtualTimeLoop, virtually

PARSING_S = 0.002  # of 4 KB on a slow machine


@dataclass
class Desk:
    """What takes messages, and how long that keeps the loop busy."""

    parsing_s: float = PARSING_S
    taken: list[tuple[float, float, str, bytes]] = field(default_factory=list)
    refused: list[tuple[str, str, str]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.loop = asyncio.get_running_loop()
        self.inbox = Inbox(
            Topics("b"),
            take=self._take,
            refuse=lambda *address: self.refused.append(address),
            now_s=self.loop.time,
        )

    def _take(self, _: object, incoming: Incoming, received_s: float) -> None:
        self.taken.append((self.loop.time(), received_s, incoming.topic, incoming.payload))
        assert isinstance(self.loop, VirtualTimeLoop)
        if incoming.payload:
            self.loop.work(self.parsing_s)

    def put(self, verb: str, *, client: str = "alice", starter: str = "pump", payload: bytes = b"{}") -> None:
        self.inbox.put(Incoming(f"b/command/{starter}/{client}/{verb}", payload))

    def of(self, verb: str) -> list[tuple[float, float, str, bytes]]:
        return [each for each in self.taken if each[2].endswith(f"/{verb}")]


@virtually
async def test_what_waits_is_parsed_in_order_with_its_time_of_arrival_in_half_of_the_time() -> None:
    desk = Desk()
    for number in range(MOST_OF_CLIENT):
        desk.put("read", payload=str(number).encode())
    began_s = desk.loop.time()
    await asyncio.sleep(PARSING_S * 25 / SHARE)
    assert 20 <= len(desk.taken) <= 35
    await asyncio.sleep(1.0)

    assert [int(payload) for *_, payload in desk.taken] == list(range(MOST_OF_CLIENT))
    assert all(received_s <= began_s for _, received_s, *_ in desk.taken)


@virtually
async def test_what_is_too_much_is_refused_unparsed_and_one_clients_flood_leaves_room_for_others() -> None:
    desk = Desk()
    for _ in range(3 * MOST):
        desk.put("read", client="mallory")
    desk.put("start", client="alice")
    await asyncio.sleep(2.0)

    assert len(desk.of("read")) + len(desk.refused) == 3 * MOST
    assert len(desk.refused) >= 2 * MOST
    assert set(desk.refused) == {("pump", "mallory", "read")}
    assert len(desk.of("start")) == 1


@virtually
async def test_a_flood_of_stops_is_carried_out_by_its_topics_alone() -> None:
    desk = Desk()
    for _ in range(3000):
        desk.put("stop")
    desk.put("stop", starter="fan")

    assert len(desk.taken) == 3001
    assert sum(payload != b"" for *_, payload in desk.taken) <= PARSED_STOPS.burst + PARSED_STOPS.per_s
    assert desk.taken[-1][2] == "b/command/fan/alice/stop"
