"""What comes while a connection is being made: a stop acts at once, a start is judged by the connection."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from gateway.app.site import Site
from gateway.app.uplink import Uplink
from gateway.config.load import parse
from gateway.mqtt.contract.commands import CommandParser, Incoming, Rejection
from gateway.mqtt.contract.freshness import Moment, RunToken, Tokens
from gateway.mqtt.contract.topics import Topics
from gateway.records import rfc3339
from gateway.system.clock import SystemClock
from tests.mqtt.fake_broker import ACCEPT_5, ACCEPT_311, LEVEL_5, LEVEL_311, REFUSE_VERSION, FakeBroker

CONFIG = (
    '[gateway]\nname = "g"\nstate_dir = "state"\n[mqtt]\nurl = "mqtt://127.0.0.1:{port}"\n'
    '[[line]]\nname = "l"\nport = "/dev/x"\nbaud = 9600\nframing = "8N2"\n'
    '[[line.starter]]\nname = "pump"\naddress = 1\nfamily = "ssw07"\n'
)


def site(folder: Path, port: int) -> Site:
    return Site.of(parse(CONFIG.format(port=port), "site.toml"), folder=folder, password=None)


class Links:
    """Receives events of the connection."""

    def __init__(self) -> None:
        self.reported: asyncio.Queue[tuple[bool, str]] = asyncio.Queue()
        self._was_reading = False

    def note(self, trouble: str | None) -> None:
        if not self._was_reading or trouble:  # that the reading has ended is not news of the connection
            self.reported.put_nowait((not trouble, trouble or ""))
        self._was_reading = trouble is None

    async def next(self) -> tuple[bool, str]:
        async with asyncio.timeout(10.0):
            return await self.reported.get()


@asynccontextmanager
async def uplink(
    first: Site,
    events: list[tuple[str, str]] | None = None,
    *,
    on_incoming: Callable[[Incoming], None] = lambda _: None,
    boot: RunToken | None = None,
) -> AsyncIterator[tuple[Uplink, Links]]:
    links = Links()
    up = Uplink(
        first,
        Tokens(boot or RunToken("run")),
        clock=SystemClock(),
        publish_event=lambda code, _severity, text, *_: (events if events is not None else []).append(
            (code, text)
        ),
    )
    up.connect(on_incoming=on_incoming, on_link=links.note)
    running = asyncio.create_task(up.run())
    yield up, links
    await up.close("over")
    running.cancel()
    await asyncio.wait((running,))


def published(level: int, verb: str, payload: bytes) -> bytes:
    """Return the packet that brings a command to the gateway."""
    topic = f"starters/g/command/pump/ha/{verb}".encode()
    body = len(topic).to_bytes(2, "big") + topic + (b"\x00" if level == LEVEL_5 else b"") + payload
    return bytes([0x30, len(body)]) + body


def spoken(level: int) -> dict[int, bytes | None]:
    """Return the answers of a broker that speaks this version of MQTT."""
    return {LEVEL_5: ACCEPT_5 if level == LEVEL_5 else REFUSE_VERSION, LEVEL_311: ACCEPT_311}


class Judges:
    """Judges what comes as the gateway does, of an operator who needs `issued_at` alone."""

    def __init__(self, boot: RunToken) -> None:
        self._parser = CommandParser(
            Topics("starters/g"), Tokens(boot), freshness_of=lambda _: ("issued_at",)
        )
        self.judged: asyncio.Queue[tuple[str, str]] = asyncio.Queue()  # verb, code; empty for what may act

    def take(self, incoming: Incoming) -> None:
        verdict = self._parser.judge(incoming, Moment(SystemClock().now_s(), SystemClock().utc_s()))
        assert verdict is not None
        request, code = (verdict.request, verdict.code) if isinstance(verdict, Rejection) else (verdict, "")
        self.judged.put_nowait((request.verb, code))


@pytest.mark.parametrize("is_before", [False, True])
@pytest.mark.parametrize("level", [LEVEL_5, LEVEL_311])
async def test_a_start_that_comes_with_the_answer_to_the_subscription_is_judged_by_the_connection(
    level: int,
    is_before: bool,
    tmp_path: Path,
) -> None:
    """Held up until then, it may be older than a stop that no gateway was there to take."""
    boot, clock = RunToken("run"), SystemClock()
    judges = Judges(boot)
    fields = {"id": "1", "issued_at": rfc3339(clock.utc_s() - 1.0), "ttl_s": 60}
    start = published(level, "start", json.dumps(fields).encode())
    how = {"before_suback": start} if is_before else {"after_suback": start}
    async with (
        FakeBroker(answers=spoken(level), **how) as broker,  # type: ignore[arg-type]  # which of two
        uplink(site(tmp_path, broker.port), on_incoming=judges.take, boot=boot) as (_, links),
        asyncio.timeout(20.0),
    ):
        assert await links.next() == (True, "")
        assert await judges.judged.get() == ("start", "before_connection")
        broker.hang_up()
        assert (await links.next())[0] is False
        assert await links.next() == (True, "")
        assert await judges.judged.get() == ("start", "before_connection")


@pytest.mark.parametrize("level", [LEVEL_5, LEVEL_311])
async def test_a_stop_waits_for_no_answer_to_the_subscription(level: int, tmp_path: Path) -> None:
    """It may be late, and is lost with the connection; what is held back until then would be too."""
    boot = RunToken("run")
    judges = Judges(boot)
    async with (
        FakeBroker(
            answers=spoken(level), answers_subscriptions=False, before_suback=published(level, "stop", b"")
        ) as broker,
        uplink(site(tmp_path, broker.port), on_incoming=judges.take, boot=boot) as (_, links),
        asyncio.timeout(20.0),
    ):
        assert await judges.judged.get() == ("stop", "")
        assert links.reported.empty()
        broker.hang_up()
        assert "sent no SUBACK" in (await links.next())[1]


@pytest.mark.parametrize("level", [LEVEL_5, LEVEL_311])
async def test_what_comes_before_the_connection_is_accepted_stops_or_is_refused(
    level: int, tmp_path: Path
) -> None:
    """No broker may do that [MQTT5 3.2]; what another device on its port sends starts nothing."""
    boot, clock = RunToken("run"), SystemClock()
    judges = Judges(boot)
    fields = {"id": "1", "issued_at": rfc3339(clock.utc_s() - 1.0), "ttl_s": 60}
    early = published(level, "start", json.dumps(fields).encode()) + published(level, "stop", b"")
    answers = spoken(level)
    answers[level] = early + (answers[level] or b"")
    async with (
        FakeBroker(answers=answers) as broker,
        uplink(site(tmp_path, broker.port), on_incoming=judges.take, boot=boot) as (_, links),
        asyncio.timeout(20.0),
    ):
        assert await links.next() == (True, "")
        assert [await judges.judged.get() for _ in range(2)] == [("start", "before_connection"), ("stop", "")]
