"""What earlier runs left retained: what is cleared, when, and when nothing is; in virtual time."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from typing import Any

import pytest

from gateway.mqtt.contract.commands import Incoming
from gateway.mqtt.contract.freshness import RunToken, Tokens
from gateway.mqtt.contract.payloads import Payloads
from gateway.mqtt.contract.topics import RetainedTopic, Topics
from gateway.mqtt.leftovers import HEARTBEAT_S, SETTLED_S, WITHIN_S, Leftovers
from gateway.records import AlarmRecord, AvailabilityRecord, LineRecord, Quality, Record, StateRecord
from tests.mqtt.rig import value
from tests.starters.rig import virtually

TOPICS = Topics("b")
EARLIER = Payloads(TOPICS, "run-1")
ROUND_TRIP_S = 0.1


def alarm(starter: str, code: str = "f072", *, is_active: bool = True) -> AlarmRecord:
    return AlarmRecord(starter, code, is_active, "fault", "Overload", 1.0, None, 1, 1)


def state(starter: str, quality: Quality = Quality.GOOD) -> StateRecord:
    return StateRecord(starter, "ready", quality, 1.0, 1)


def left(*records: Record) -> dict[str, bytes]:
    return {made.topic: made.payload for made in map(EARLIER.message, records)}


STATISTICS = {"utilisation": 0.1, "polls": 1, "answered": 1, "silent": 0}
REMOVED = left(
    AvailabilityRecord("old", "offline", 1.0, None),
    state("old"),
    value(1, 12.0),  # of pump-1, which is not configured
    alarm("old"),
    alarm("old", "a1", is_active=False),
    LineRecord("yard", STATISTICS),
)


class Rig:
    """A run on base `b` with the starter `pump` on the line `hall`, at a broker that has stored topics."""

    def __init__(self, stored: dict[str, bytes], *, denies: bool = False, refuses: bool = False) -> None:
        self.stored = dict(stored)
        self._denies, self._refuses = denies, refuses
        self.tokens = Tokens(RunToken("run-2"))
        self.published: set[str] = set()
        self.cleared: list[str] = []
        self.events: list[str] = []
        self.branches: set[str] = set()
        self.online_s: float | None = None
        self.leftovers = Leftovers(
            TOPICS,
            self.tokens,
            is_current=self._is_current,
            is_published=self.published.__contains__,
            clear=self.cleared.append,
            publish_event=lambda code, *_: self.events.append(code),
            on_read=self._note_read,
        )

    async def connect(self) -> None:
        self.leftovers.connected(self)
        await asyncio.sleep(ROUND_TRIP_S)
        if not self._denies and not self._refuses:
            self.heartbeat(self.tokens.issue(0.0))

    def heartbeat(self, token: str) -> None:
        self.take("b/gateway/fresh", {"token": token, "time": None})

    def take(self, topic: str, fields: Any, *, is_retained: bool = False) -> None:
        self.leftovers.take(Incoming(topic, json.dumps(fields).encode(), is_retained=is_retained))

    # The connection

    def read(self, topic_filter: str, on_answer: Callable[[bool], None]) -> None:
        self.branches.add(topic_filter)
        loop = asyncio.get_running_loop()
        loop.call_later(ROUND_TRIP_S / 2, on_answer, not self._refuses)
        for topic, payload in self.stored.items():
            if not self._denies and not self._refuses and topic.startswith(topic_filter.removesuffix("#")):
                message = Incoming(topic, payload, is_retained=True)
                loop.call_later(ROUND_TRIP_S / 2, self.leftovers.take, message)

    def unread(self, topic_filter: str) -> None:
        self.branches.remove(topic_filter)

    def _is_current(self, found: RetainedTopic) -> bool:
        return found.name == ("hall" if found.kind == "line" else "pump")

    def _note_read(self) -> None:
        self.online_s = asyncio.get_running_loop().time()


@virtually
async def test_what_is_left_of_removed_starters_and_lines_is_cleared_and_then_the_gateway_is_online() -> None:
    staying = left(state("pump"), alarm("pump", is_active=False), LineRecord("hall", STATISTICS))
    rig = Rig(REMOVED | staying)
    await rig.connect()
    await asyncio.sleep(0)

    assert rig.cleared == sorted(REMOVED)
    assert rig.online_s == pytest.approx(ROUND_TRIP_S)
    assert rig.events == []
    assert rig.branches == {"b/gateway/status", "b/gateway/fresh"}


FOREIGN = {
    "b/starter/old/state": b"on",
    "b/starter/old/value/current": b'{"value":1.0}',
    "b/starter/old/value/p002/raw": b'{"value":1.0,"unit":"A","quality":"good","time":null,"seq":1}',
    "b/starter/old/note": b'{"state":"x","since":null,"reason":null}',
    "b/starter/OLD/availability": b'{"state":"x","since":null,"reason":null}',
    "b/gateway/note": b'{"state":"x","since":null,"reason":null}',
    "b/gateway/line/yard": b'{"polls":1}',
}


@virtually
async def test_what_others_left_there_is_not_cleared() -> None:
    rig = Rig(FOREIGN)
    await rig.connect()
    await asyncio.sleep(WITHIN_S)

    assert rig.cleared == []
    assert rig.online_s is not None


@virtually
async def test_an_alarm_that_ended_meanwhile_is_cleared_once_its_starter_was_read_and_before_online() -> None:
    rig = Rig(left(alarm("pump", "f072"), alarm("pump", "f078"), alarm("pump", "a1", is_active=False)))
    await rig.connect()
    await asyncio.sleep(1.0)
    rig.leftovers.put(state("pump", Quality.STALE))
    assert (rig.cleared, rig.online_s) == ([], None)

    rig.leftovers.put(state("pump"))
    rig.published.add("b/starter/pump/alarm/f078")  # it is active in this run, too
    await asyncio.sleep(SETTLED_S + 0.1)

    assert rig.cleared == ["b/starter/pump/alarm/f072"]
    assert rig.online_s == pytest.approx(ROUND_TRIP_S + 1.0 + SETTLED_S)


@virtually
async def test_an_alarm_of_a_starter_that_does_not_answer_stays_until_it_is_read() -> None:
    rig = Rig(left(alarm("pump")) | REMOVED)
    await rig.connect()
    await asyncio.sleep(WITHIN_S + 1.0)

    assert rig.online_s == pytest.approx(WITHIN_S)
    assert rig.cleared == sorted(REMOVED)
    rig.leftovers.put(state("pump"))
    await asyncio.sleep(SETTLED_S + 0.1)
    assert rig.cleared[-1] == "b/starter/pump/alarm/f072"
    assert rig.events == []


@virtually
async def test_an_alarm_of_this_run_is_left_alone() -> None:
    rig = Rig({"b/starter/pump/alarm/f072": Payloads(TOPICS, "run-2").message(alarm("pump")).payload})
    rig.leftovers.put(state("pump"))
    await rig.connect()
    await asyncio.sleep(WITHIN_S)

    assert rig.cleared == []


@pytest.mark.parametrize(("how", "after_s"), [("denies", WITHIN_S), ("refuses", ROUND_TRIP_S / 2)])
@virtually
async def test_a_broker_that_does_not_let_it_read_is_reported_and_the_gateway_is_online_all_the_same(
    how: str, after_s: float
) -> None:
    rig = Rig(REMOVED, denies=how == "denies", refuses=how == "refuses")
    await rig.connect()
    await asyncio.sleep(WITHIN_S + 1.0)

    assert rig.events == ["leftovers_unread"]
    assert rig.cleared == []
    assert rig.online_s == pytest.approx(after_s)


@virtually
async def test_a_connection_that_is_lost_while_reading_is_followed_by_another_reading() -> None:
    rig = Rig(REMOVED, denies=True)
    await rig.connect()
    await asyncio.sleep(1.0)
    rig.leftovers.disconnected()
    await asyncio.sleep(WITHIN_S)
    assert (rig.online_s, rig.events) == (None, [])

    rig._denies = False
    await rig.connect()
    await asyncio.sleep(0.1)

    assert rig.cleared == sorted(REMOVED)


ONLINE_BEFORE = {"b/gateway/status": EARLIER.status("online", time_s=1.0, since_s=1.0, reason=None).payload}


@virtually
async def test_a_status_that_a_gateway_left_which_died_with_its_broker_prevents_nothing() -> None:
    rig = Rig(ONLINE_BEFORE | REMOVED)
    await rig.connect()
    await asyncio.sleep(WITHIN_S)

    assert rig.events == []
    assert rig.cleared == sorted(REMOVED)
    assert rig.online_s == pytest.approx(ROUND_TRIP_S + HEARTBEAT_S)


@virtually
async def test_while_another_gateway_is_there_nothing_is_cleared_and_it_is_reported_once() -> None:
    rig = Rig(ONLINE_BEFORE | REMOVED | left(alarm("pump")))
    await rig.connect()
    rig.leftovers.put(state("pump"))
    for second in range(100):
        rig.heartbeat(f"another's {second}")
        await asyncio.sleep(1.0)

    assert rig.events == ["base_shared"]
    assert rig.cleared == []
    assert rig.online_s == pytest.approx(ROUND_TRIP_S)
    for _ in range(2):  # after it had gone
        await asyncio.sleep(61.0)
        rig.heartbeat("another's")
    assert rig.events == ["base_shared"] * 3


@virtually
async def test_no_ended_alarm_is_cleared_while_it_is_open_whether_another_gateway_is_there() -> None:
    rig = Rig(ONLINE_BEFORE | left(alarm("pump")))
    rig.leftovers.put(state("pump"))
    await asyncio.sleep(SETTLED_S - 1.0)
    await rig.connect()
    await asyncio.sleep(2.0)  # the starter's alarms are known now
    rig.heartbeat("another's")
    await asyncio.sleep(WITHIN_S)

    assert rig.events == ["base_shared"]
    assert rig.cleared == []


@pytest.mark.parametrize(
    ("run", "state", "events"),
    [
        ("run-1", "starting", ["base_shared"]),
        ("run-1", "online", ["base_shared"]),
        ("run-1", "offline", []),  # a late will
        ("run-2", "online", []),
    ],
)
@virtually
async def test_a_status_that_comes_now_shows_another_gateway_at_once(
    run: str, state: str, events: list[str]
) -> None:
    rig = Rig({})
    await rig.connect()
    await asyncio.sleep(1.0)
    rig.take("b/gateway/status", {"state": state, "run": run})

    assert rig.events == events


@virtually
async def test_its_own_token_is_never_taken_for_anothers_even_when_it_counts_no_longer() -> None:
    rig = Rig({})
    await rig.connect()
    token = rig.tokens.issue(1.0)
    rig.tokens.boot.stood_still(2.0)
    rig.heartbeat(token)
    rig.take("b/gateway/fresh", {"token": "of an earlier run"}, is_retained=True)
    rig.take("b/gateway/status", "nonsense")
    rig.leftovers.take(Incoming("b/gateway/fresh", b""))  # somebody clears it

    assert rig.events == []
