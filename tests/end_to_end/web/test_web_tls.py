"""The page that speaks TLS itself, to a real client of it, and its certificate when that is renewed."""

from __future__ import annotations

import asyncio
import json
import ssl
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from gateway.plugins.web.interface import WebSettings, WebUser
from gateway.plugins.web.service import WebService
from gateway.system.clock import SystemClock
from gateway.system.password_hash import password_line
from tests.end_to_end.web.raw_client import RawAnswer, read_answer, request, until
from tests.mosquitto import Certificate
from tests.web.support import FakeAccess, shown_site

PATIENCE_S = 10.0
PASSWORD = "correct horse"


@dataclass
class TlsPage:
    """A page with a certificate in a folder, and who is its client."""

    service: WebService
    settings: WebSettings
    folder: Path
    troubles: list[str] = field(default_factory=list)
    old: list[str] = field(default_factory=list)  # why a certificate goes on

    @property
    def port(self) -> int:
        assert self.service.address is not None
        return self.service.address[1]

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
        self.service.move(self.settings, shown_site())


async def asked(reader: asyncio.StreamReader, writer: asyncio.StreamWriter, data: bytes) -> RawAnswer:
    async with asyncio.timeout(PATIENCE_S):
        writer.write(data)
        return await read_answer(reader)


@asynccontextmanager
async def tls_page(folder: Path) -> AsyncIterator[TlsPage]:
    """Serve a page with a certificate of its own."""
    made = Certificate.make(folder)
    settings = WebSettings(
        port=0,
        cert_file=str(made.cert),
        key_file=str(made.key),
        users={"anna": WebUser("anna", "alice", password_line(PASSWORD))},
    )
    troubles: list[str] = []
    old: list[str] = []
    service = WebService(
        settings,
        shown_site(),
        FakeAccess(),
        SystemClock(),
        on_trouble=troubles.append,
        on_old_certificate=old.append,
    )
    task = asyncio.create_task(service.run())
    try:
        await until(lambda: service.address is not None or task.done())
        yield TlsPage(service, settings, folder, troubles, old)
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


def shown(writer: asyncio.StreamWriter) -> bytes:
    """Return the certificate that the page has shown to a client."""
    tls: ssl.SSLObject = writer.get_extra_info("ssl_object")
    return tls.getpeercert(binary_form=True) or b""


def on_disk(folder: Path) -> bytes:
    return ssl.PEM_cert_to_DER_cert((folder / "broker.pem").read_text("ascii"))


async def test_with_tls_the_cookie_is_for_tls_alone_and_the_browser_is_to_remember_it(tmp_path: Path) -> None:
    async with tls_page(tmp_path) as page:
        body = json.dumps({"user": "anna", "password": PASSWORD}).encode()
        index = await page.ask(request("GET", "/", port=page.port))
        origin = {"Origin": f"https://127.0.0.1:{page.port}"}
        login = await page.ask(request("POST", "/api/v1/login", body, port=page.port, headers=origin))

        assert (index.status, login.status) == (200, 200)
        assert index.headers["strict-transport-security"] == "max-age=31536000"
        assert login.headers["set-cookie"].startswith("__Host-sid=")
        assert login.headers["set-cookie"].endswith("Secure")
        assert page.troubles == [""]


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
        assert page.old == []
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
        await until(lambda: bool(page.old))
        (tmp_path / broken).write_bytes(good)

        reader, writer = await page.connect()
        assert (await asked(reader, writer, request("GET", "/", port=page.port))).status == 200
        assert shown(writer) == on_disk(tmp_path)
        assert page.troubles == [""]
        writer.close()
