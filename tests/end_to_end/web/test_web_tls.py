"""The page that speaks TLS itself, to a real client of it, and its certificate when that is renewed."""

from __future__ import annotations

import asyncio
import ssl
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import pytest

from gateway.plugins.web.page import Page
from gateway.plugins.web.plugin import WebSettings, WebUser
from gateway.plugins.web.server import Server
from gateway.system.clock import SystemClock
from gateway.system.password_hash import password_line
from tests.end_to_end.web.raw_client import RawAnswer, read_answer, request
from tests.mosquitto import Certificate, free_port
from tests.waiting import until
from tests.web.support import FakeGateway, web_settings

PATIENCE_S = 10.0
PASSWORD = "correct horse"


@dataclass
class TlsPage:
    """A page with a certificate in a folder, and who is its client."""

    page: Page
    settings: WebSettings
    folder: Path
    gateway: FakeGateway
    servers: list[Server] = field(default_factory=list)

    @property
    def port(self) -> int:
        return self.settings.port

    async def connect(self) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
        """Connect as a browser that trusts the certificate in the folder, and no other."""
        context = ssl.create_default_context(cafile=str(self.folder / "broker.pem"))
        async with asyncio.timeout(PATIENCE_S):
            return await asyncio.open_connection(
                "127.0.0.1", self.port, ssl=context, server_hostname="localhost"
            )

    async def ask(self, data: bytes) -> RawAnswer:
        reader, writer = await self.connect()
        answer = await asked(reader, writer, data)
        writer.close()
        return answer

    def reload(self) -> None:
        """Apply the configuration as it was: what its files hold may be new."""
        self.page.reconfigure(self.settings)


async def asked(reader: asyncio.StreamReader, writer: asyncio.StreamWriter, data: bytes) -> RawAnswer:
    async with asyncio.timeout(PATIENCE_S):
        writer.write(data)
        return await read_answer(reader)


@asynccontextmanager
async def tls_page(folder: Path) -> AsyncIterator[TlsPage]:
    """Serve a page with a certificate of its own."""
    made = Certificate.make(folder)
    settings = web_settings(
        port=free_port(),
        cert_file=str(made.cert),
        key_file=str(made.key),
        users={"anna": WebUser("anna", "alice", password_line(PASSWORD))},
    )
    servers: list[Server] = []

    def make(app: Any, settings: WebSettings) -> Server:
        servers.append(Server(app, settings))
        return servers[-1]

    gateway = FakeGateway(SystemClock(), make_web_server=make)
    page = Page(cast("Any", gateway), settings)
    task = asyncio.create_task(page.run())
    try:
        await until(lambda: bool(servers and servers[-1].is_open.is_set()) or task.done())
        yield TlsPage(page, settings, folder, gateway, servers)
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


def shown(writer: asyncio.StreamWriter) -> bytes:
    """Return the certificate that the page has shown to a client."""
    tls: ssl.SSLObject = writer.get_extra_info("ssl_object")
    return tls.getpeercert(binary_form=True) or b""


def on_disk(folder: Path) -> bytes:
    return ssl.PEM_cert_to_DER_cert((folder / "broker.pem").read_text("ascii"))


async def test_a_renewed_certificate_of_the_same_name_is_shown_to_new_connections_and_ends_none(
    tmp_path: Path,
) -> None:
    async with tls_page(tmp_path) as page:
        reader, writer = await page.connect()
        before = shown(writer)
        Certificate.make(tmp_path)
        page.reload()

        async with asyncio.timeout(PATIENCE_S):
            while True:
                with suppress(ssl.SSLCertVerificationError):  # until it is read, the one before is shown
                    _, new = await page.connect()
                    break
                await asyncio.sleep(0.02)
        assert before != shown(new) == on_disk(tmp_path)
        assert (await asked(reader, writer, request("GET", "/", port=page.port))).status == 200
        assert "web_certificate" not in page.gateway.events
        writer.close()
        new.close()


@pytest.mark.parametrize("broken", ["broker.pem", "broker.key"])
async def test_a_certificate_that_cannot_be_used_is_reported_and_the_one_before_goes_on(
    tmp_path: Path, broken: str
) -> None:
    async with tls_page(tmp_path) as page:
        good = (tmp_path / broken).read_bytes()
        (tmp_path / broken).write_text("half a file")
        page.reload()
        await until(lambda: "web_certificate" in page.gateway.events)
        (tmp_path / broken).write_bytes(good)

        reader, writer = await page.connect()
        assert (await asked(reader, writer, request("GET", "/", port=page.port))).status == 200
        assert shown(writer) == on_disk(tmp_path)
        assert "web_away" not in page.gateway.events
        writer.close()
