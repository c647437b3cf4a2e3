"""The stream: snapshot first, then changes at the client's pace, beats, and its bounds; in virtual time."""

from __future__ import annotations

import asyncio
import json
from itertools import pairwise
from typing import Any

from gateway.records import EventRecord, Severity
from gateway.web.accounts import LoginOutcome
from gateway.web.requests import Caller
from gateway.web.site_model import MOST_MESSAGES
from gateway.web.streams import BEAT_S, EVERY_S, MOST_STREAMS, EventStream, Stream
from tests.starters.rig import virtually
from tests.virtual_time import VirtualClock
from tests.web.support import PageRig

MOST_OF_OWNER = 4


class Client:
    """A browser on the stream: each event with the time at which it came; it can stop to read."""

    def __init__(self, rig: PageRig, scope: str | None = None, **options: Any) -> None:
        self.stream = Stream(scope, options.pop("owner", "10.0.0.1"), b'{"user":null}', **options)
        self.events: list[tuple[float, str, Any]] = []
        self.why_not = rig.streams.join(self.stream, most_of_owner=MOST_OF_OWNER)
        self.reading = asyncio.Event()
        self.reading.set()
        self.has_ended = False
        self._rig = rig
        self._gone = asyncio.Event()
        self._buffer = b""
        self._task = asyncio.create_task(self._run())

    async def _run(self) -> None:
        await EventStream(self._rig.streams, self.stream)({}, self._receive, self._send)
        self.has_ended = True

    async def _receive(self) -> Any:
        await self._gone.wait()
        return {"type": "http.disconnect"}

    async def _send(self, message: Any) -> None:
        await self.reading.wait()
        self._buffer += message.get("body", b"")
        *whole, self._buffer = self._buffer.split(b"\n\n")
        for text in whole:
            name, _, data = text.decode().partition("\ndata: ")
            if name.startswith("event: "):
                self.events.append((asyncio.get_running_loop().time(), name[7:], json.loads(data)))

    async def leave(self) -> None:
        self._gone.set()
        await self._task

    def of(self, *names: str) -> list[Any]:
        return [data for _, name, data in self.events if name in names]


def rig_now() -> PageRig:
    return PageRig(clock=VirtualClock(asyncio.get_running_loop()))


@virtually
async def test_changes_are_sent_at_most_every_250_ms_and_the_first_at_once() -> None:
    rig = rig_now()
    client = Client(rig)
    await asyncio.sleep(11.0)  # between two beats
    began_s = asyncio.get_running_loop().time()

    for n in range(400):
        rig.value("pump-1", "current", float(n))
        await asyncio.sleep(0.01)
    await asyncio.sleep(1.0)
    await client.leave()

    times = [at_s for at_s, name, _ in client.events if name == "change"]
    assert times[0] - began_s < 0.05
    gaps = [after - before for before, after in pairwise(times)]
    assert min(gaps) > EVERY_S - 0.001
    assert client.of("change")[-1]["topics"]["starter/pump-1/value/current"]["value"] == 399.0


@virtually
async def test_a_quiet_stream_beats_every_five_seconds_with_a_token_and_a_busy_one_needs_no_beat() -> None:
    rig = rig_now()
    client, scoped = Client(rig), Client(rig, "pump-1", owner="10.0.0.2")
    await asyncio.sleep(31.0)
    for each in (client, scoped):
        times = [at_s for at_s, _, _ in each.events]
        gaps = [after - before for before, after in pairwise(times)]
        assert all(BEAT_S - 1.0 <= gap <= BEAT_S + 1.0 for gap in gaps)
        assert len(each.of("beat")) >= 5
        assert all(beat.keys() == {"gen", "time", "token"} for beat in each.of("beat"))
    before = len(client.events)
    for n in range(100):
        rig.value("pump-2", "p002", float(n))  # which the overview does not show
        await asyncio.sleep(0.1)
    assert len(client.events) - before <= 3, "what is out of scope wakes no client"
    await client.leave()
    await scoped.leave()


@virtually
async def test_a_client_that_stops_reading_skips_what_lies_between_and_costs_no_memory() -> None:
    rig = rig_now()
    client = Client(rig)
    await asyncio.sleep(1.0)
    client.reading.clear()
    for n in range(5_000):
        rig.value("pump-1", "current", float(n))
        if n % 100 == 0:
            await asyncio.sleep(0.1)
    before = len(client.events)

    client.reading.set()
    await asyncio.sleep(1.0)
    await client.leave()

    late = client.events[before:]
    assert len(late) <= 3
    assert late[-1][2]["topics"]["starter/pump-1/value/current"]["value"] == 4999.0


@virtually
async def test_a_client_that_has_missed_messages_gets_the_whole_again() -> None:
    rig = rig_now()
    client = Client(rig)
    await asyncio.sleep(1.0)
    client.reading.clear()
    for n in range(MOST_MESSAGES + 50):
        rig.publish(EventRecord("", "lag", Severity.INFO, "x", 1.0, n, {}))
        await asyncio.sleep(0.01)

    client.reading.set()
    await asyncio.sleep(1.0)
    await client.leave()

    assert len(client.of("snapshot")) == 2
    assert len(client.of("snapshot")[-1]["messages"]) == MOST_MESSAGES


@virtually
async def test_every_event_is_sent_exactly_once_and_in_order() -> None:
    rig = rig_now()
    client = Client(rig)
    await asyncio.sleep(1.0)
    for n in range(150):
        rig.publish(EventRecord("", "lag", Severity.INFO, str(n), 1.0, n, {}))
        await asyncio.sleep(0.03)
    await asyncio.sleep(1.0)
    await client.leave()

    texts = [each["payload"]["text"] for data in client.of("change") for each in data["messages"]]
    assert texts == [str(n) for n in range(150)]


@virtually
async def test_actions_come_with_the_snapshot_and_again_when_they_change_though_no_value_does() -> None:
    rig = rig_now()
    rig.access.offers = [{"verb": "start", "permitted": False, "text": "wait 20 s"}]
    client = Client(rig, "pump-1", client="alice")
    await asyncio.sleep(3.0)
    assert client.of("snapshot")[0]["actions"] == [{**rig.access.offers[0], "client": "alice"}]

    rig.access.offers = [{"verb": "start", "permitted": True, "text": ""}]
    await asyncio.sleep(1.5)
    await client.leave()

    [change] = client.of("change")
    assert change["actions"][0]["permitted"] is True
    assert change["topics"] == {}


@virtually
async def test_streams_are_bounded_in_number_altogether_and_of_one_owner() -> None:
    rig = rig_now()
    same = [Client(rig, owner="a") for _ in range(MOST_OF_OWNER + 1)]
    others = [Client(rig, owner=f"o{n}") for n in range(MOST_STREAMS)]
    assert [each.why_not for each in same[:-1]] == [""] * MOST_OF_OWNER
    assert same[-1].why_not.startswith("too many pages are open here (4 of 4)")
    assert [each.why_not for each in (*same, *others)].count("") == MOST_STREAMS == len(rig.streams)
    assert others[-1].why_not == "too many pages are open (48 of 48): close one"

    for each in (*same, *others):
        await each.leave()

    assert len(rig.streams) == 0
    answer = await rig.get("/api/v1/state")  # and the page itself goes on
    assert answer.status == 200


async def test_the_headers_keep_proxies_from_holding_the_stream_back() -> None:
    rig = PageRig()
    stream = Stream(None, "o", b"{}")
    rig.streams.join(stream, most_of_owner=1)
    rig.streams.end()

    sent: list[Any] = []

    async def send(message: Any) -> None:
        sent.append(message)

    async def receive() -> Any:
        return {"type": "http.disconnect"}

    await EventStream(rig.streams, stream)({}, receive, send)
    headers = dict(sent[0]["headers"])
    assert headers[b"x-accel-buffering"] == b"no"
    assert headers[b"cache-control"] == b"no-store"
    assert headers[b"content-type"].startswith(b"text/event-stream")


def test_an_outcome_of_a_login_does_not_show_its_secret() -> None:
    assert "s3cret" not in repr(LoginOutcome(secret="s3cret"))
    assert Caller("a", "b", "https").is_tls
