"""The page that speaks TLS itself, to a real client of it, and its certificate when that is renewed."""

from __future__ import annotations

import asyncio
import ssl
from pathlib import Path

import pytest

from tests.end_to_end.web.raw_client import read_status, request
from tests.end_to_end.web.served import served
from tests.mosquitto import Certificate


async def connect(port: int, folder: Path) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
    """Connect as a browser that trusts the certificate in the folder, and no other."""
    context = ssl.create_default_context(cafile=str(folder / "broker.pem"))
    async with asyncio.timeout(10.0):
        return await asyncio.open_connection("127.0.0.1", port, ssl=context, server_hostname="localhost")


async def answers(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> bool:
    async with asyncio.timeout(10.0):
        writer.write(request("GET", "/api/v1/state", port=writer.get_extra_info("peername")[1]))
        return await read_status(reader) == 200


def is_shown(writer: asyncio.StreamWriter, folder: Path) -> bool:
    """Return whether the page has shown a client the certificate that is in the folder now."""
    tls: ssl.SSLObject = writer.get_extra_info("ssl_object")
    on_disk = ssl.PEM_cert_to_DER_cert((folder / "broker.pem").read_text("ascii"))
    return tls.getpeercert(binary_form=True) == on_disk


async def test_a_renewed_certificate_of_the_same_name_is_shown_to_new_connections_and_ends_none(
    tmp_path: Path,
) -> None:
    async with served(certificate=Certificate.make(tmp_path)) as (_, server, port):
        reader, writer = await connect(port, tmp_path)
        Certificate.make(tmp_path)
        await server.renew()
        _, new = await connect(port, tmp_path)

        assert (is_shown(writer, tmp_path), is_shown(new, tmp_path)) == (False, True)
        assert await answers(reader, writer)
        writer.close()
        new.close()


@pytest.mark.parametrize("broken", ["broker.pem", "broker.key"])
async def test_a_certificate_that_cannot_be_used_is_an_error_and_the_one_before_goes_on(
    tmp_path: Path, broken: str
) -> None:
    async with served(certificate=Certificate.make(tmp_path)) as (_, server, port):
        good = (tmp_path / broken).read_bytes()
        (tmp_path / broken).write_text("half a file")
        with pytest.raises(OSError, match="cert_file"):
            await server.renew()
        (tmp_path / broken).write_bytes(good)

        reader, writer = await connect(port, tmp_path)
        assert await answers(reader, writer)
        assert is_shown(writer, tmp_path)
        writer.close()
