"""`/metrics` and `/health`: who is answered, and what."""

from __future__ import annotations

import asyncio
import gzip
from dataclasses import replace

import pytest

from gateway.web.interface import WebSettings
from tests.web.support import SETTINGS, FakeMetrics, PageRig

HERE, THERE = "127.0.0.1", "192.0.2.7"
PROXIED = replace(SETTINGS, trusted_proxies=("127.0.0.1",))


def rig_of(token: str | None = None, settings: WebSettings = SETTINGS) -> PageRig:
    rig = PageRig(settings)
    rig.access.scraped = FakeMetrics(token)
    return rig


async def test_the_text_has_prometheus_type_and_is_compressed_on_request() -> None:
    plain = await rig_of().get("/metrics")
    small = await rig_of().get("/metrics", accept_encoding="gzip")
    refused = await rig_of().get("/metrics", accept_encoding="gzip;q=0")

    assert plain.headers["content-type"] == "text/plain; version=0.0.4; charset=utf-8"
    assert plain.headers["cache-control"] == "no-store"
    assert gzip.decompress(small.body) == plain.body
    assert len(small.body) < len(plain.body) / 10
    assert refused.body == plain.body


async def test_a_proxys_callers_are_judged_by_where_they_come_from() -> None:
    rig = rig_of(settings=PROXIED)

    plain = await rig.get("/metrics", x_forwarded_for=THERE)
    encrypted = await rig.get("/metrics", x_forwarded_for=THERE, x_forwarded_proto="https")

    assert (plain.status, encrypted.status) == (403, 200)


async def test_a_scrape_that_fails_by_a_bug_is_answered_500_and_the_page_goes_on() -> None:
    rig = rig_of()

    async def fail() -> bytes:
        raise ZeroDivisionError("ordered")

    assert rig.access.scraped is not None
    rig.access.scraped.text = fail  # type: ignore[method-assign]

    assert (await rig.get("/metrics")).status == 500
    assert (await rig.get("/api/v1/session")).status == 200


async def test_while_a_scrape_waits_for_its_thread_the_page_answers() -> None:
    rig, done = rig_of(), asyncio.Event()

    async def slow() -> bytes:
        await done.wait()
        return b""

    assert rig.access.scraped is not None
    rig.access.scraped.text = slow  # type: ignore[method-assign]
    scrape = asyncio.create_task(rig.get("/metrics"))
    session = await rig.get("/api/v1/session")
    assert not scrape.done()
    done.set()

    assert (session.status, (await scrape).status) == (200, 200)


@pytest.mark.parametrize(
    ("lines", "broker", "status"),
    [
        ({"pumps": True, "fans": True}, True, 200),
        ({"pumps": True, "fans": True}, False, 200),  # a restart would not bring the broker back
        ({"pumps": True, "fans": False}, True, 503),
    ],
)
async def test_health_asks_whether_every_line_moves(
    lines: dict[str, bool], broker: bool, status: int
) -> None:
    rig = PageRig()
    rig.model.publish("starters/mcc1/gateway/status", b'{"state":"online"}', is_retained=True)
    rig.access.well = {"lines": lines, "broker": broker}

    answer = await rig.get("/health")

    assert answer.status == status
    assert answer.json == {"state": "online", "lines": lines, "broker": broker}
