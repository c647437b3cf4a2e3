"""The page behind a proxy that speaks TLS and serves it below a path."""

from __future__ import annotations

import asyncio
import ssl
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path

import pytest
from playwright.async_api import expect

from tests.end_to_end.page.support import browser, hold_to_start, logged_in, page_plant
from tests.mosquitto import Certificate, StartMosquitto

pytestmark = [pytest.mark.long]

PROXIED = '\nbase_path = "/mcc1"\nhosts = ["localhost"]\ntrusted_proxies = ["127.0.0.1"]\n'


@asynccontextmanager
async def proxy(target: int, certificate: Certificate) -> AsyncIterator[int]:
    """Serve TLS; each request goes on over a connection of its own, with what proxies add."""
    tasks: set[asyncio.Task[None]] = set()

    async def pump(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with suppress(ConnectionError, ssl.SSLError):
            while chunk := await reader.read(65536):
                writer.write(chunk)
                await writer.drain()
        writer.close()

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        tasks.add(asyncio.current_task())  # type: ignore[arg-type]
        with suppress(asyncio.IncompleteReadError, ConnectionError):
            head = await reader.readuntil(b"\r\n\r\n")
            there, back = await asyncio.open_connection("127.0.0.1", target)
            added = b"X-Forwarded-Proto: https\r\nX-Forwarded-For: 192.0.2.7\r\nConnection: close\r\n\r\n"
            lines = [each for each in head[:-4].split(b"\r\n") if not each.lower().startswith(b"connection")]
            back.write(b"\r\n".join([*lines, added]))
            try:
                await asyncio.gather(pump(reader, back), pump(there, writer))
            finally:
                back.close()

    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(certificate.cert, certificate.key)
    server = await asyncio.start_server(serve, "127.0.0.1", 0, ssl=context)
    try:
        yield server.sockets[0].getsockname()[1]
    finally:
        server.close()
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        await asyncio.sleep(0)  # then the loop closes the transports


async def test_behind_a_proxy_with_tls_and_below_a_path_everything_works(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    certificate = Certificate.make(tmp_path)
    async with (
        page_plant(start_mosquitto(), tmp_path, web=PROXIED) as plant,
        proxy(plant.port, certificate) as port,
        browser() as chromium,
    ):
        url = f"https://localhost:{port}/mcc1/"
        page = await chromium.open(f"{url}#/starter/pump", ignore_https_errors=True)
        await logged_in(page)
        cookies = await page.context.cookies()
        await hold_to_start(page)
        await plant.scada.result("pump", verb="start", phase="confirmed")
        await page.click("button.stop")
        await plant.scada.result("pump", verb="stop", phase="confirmed")
        await page.goto(url[:-1])
        await expect(page.locator("li[data-starter]")).to_have_count(4)
        journal = plant.gateway.output

    assert [(each["name"], each["secure"], each["httpOnly"], each["sameSite"]) for each in cookies] == [
        ("__Host-sid", True, True, "Strict")
    ]
    assert "client=alice address=192.0.2.7 ok" in journal
