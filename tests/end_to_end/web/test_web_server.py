"""The page's socket under clients that mean no good: slow, huge, malformed, many."""

from __future__ import annotations

import asyncio
import random
import shutil
import socket
import ssl
import struct
from contextlib import suppress
from pathlib import Path

import pytest

from gateway.plugins.web import server as web_server
from gateway.plugins.web.server import MOST_CONNECTIONS
from tests.end_to_end.web.raw_client import exchange, request
from tests.end_to_end.web.served import served
from tests.mosquitto import Certificate
from tests.waiting import until
from tests.web.support import PageRig, web_settings

QUICK_S = 0.6


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let every deadline of a connection be short."""
    for wait in web_server._LIMITS_S:
        monkeypatch.setitem(web_server._LIMITS_S, wait, QUICK_S)
    monkeypatch.setattr(web_server, "LOOK_S", 0.1)


async def is_well(port: int) -> bool:
    return await exchange(port, request("GET", "/api/v1/state", port=port)) == 200


def malformed(chance: random.Random) -> bytes:
    """Return something that is no request, or a request with something wrong."""
    good = request("POST", "/api/v1/login", b'{"user":"x"}', port=1)
    match chance.randrange(8):
        case 0:
            return chance.randbytes(chance.randrange(1, 300))
        case 1:
            return good[: chance.randrange(1, len(good))] + b"\x00\xff\r\n\r\n"
        case 2:
            place = chance.randrange(len(good))
            return good[:place] + chance.randbytes(3) + good[place + 1 :]
        case 3:
            return b"GET / HTTP/1.1\r\nHost: a\r\nHost: b\r\n\r\n"
        case 4:
            return b"POST / HTTP/1.1\r\nHost: x\r\nContent-Length: 5\r\nContent-Length: 6\r\n\r\nabcdef"
        case 5:
            head = b"POST / HTTP/1.1\r\nHost: x\r\nTransfer-Encoding: chunked\r\nContent-Length: 3\r\n\r\n"
            return head + b"zz\r\n\r\n"
        case 6:
            return b"GET " + b"/" * chance.randrange(9000) + b" HTTP/9.9\r\n\r\n"
        case _:
            return b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + chance.randbytes(
                50
            )  # TLS to a plain port


async def hit(port: int, data: bytes) -> None:
    """Send bytes and reset the connection."""
    loop = asyncio.get_running_loop()
    with socket.socket() as sock, suppress(OSError, TimeoutError):
        sock.setblocking(False)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        await loop.sock_connect(sock, ("127.0.0.1", port))
        async with asyncio.timeout(0.02):
            await loop.sock_sendall(sock, data)
            await loop.sock_recv(sock, 4096)


@pytest.mark.long
async def test_ten_thousand_malformed_requests_change_nothing_and_log_nothing(
    caplog: pytest.LogCaptureFixture,
) -> None:
    chance = random.Random(8480)
    errors: list[object] = []
    asyncio.get_running_loop().set_exception_handler(lambda _, context: errors.append(context))
    async with served() as (rig, server, port):
        for _ in range(500):
            await asyncio.gather(*(hit(port, malformed(chance)) for _ in range(20)))

        assert await is_well(port)
        assert rig.control.commands == []
        assert set(rig.gateway.logins) <= {"wrong_login"}
        assert len(server._connections) < MOST_CONNECTIONS
    assert errors == []
    assert len(caplog.records) <= 5, [record.getMessage() for record in caplog.records[:9]]


@pytest.mark.usefixtures("quick")
async def test_a_client_that_sends_its_head_byte_by_byte_is_cut_off() -> None:
    async with served() as (_, _, port):
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        began_s = asyncio.get_running_loop().time()
        with suppress(OSError):
            for (
                sign
            ) in b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX-Slow: aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa":
                writer.write(bytes((sign,)))
                await writer.drain()
                await asyncio.sleep(0.05)
        with suppress(OSError):
            assert await reader.read() == b""

        assert asyncio.get_running_loop().time() - began_s < 10 * QUICK_S
        assert await is_well(port)


@pytest.mark.usefixtures("quick")
async def test_a_client_that_never_sends_its_body_or_nothing_at_all_is_cut_off() -> None:
    async with served() as (_, _, port):
        for sent in (b"", request("POST", "/api/v1/login", b"x" * 20, port=port)[:-19]):
            assert await exchange(port, sent, within_s=5.0) == 0


@pytest.mark.usefixtures("quick")
async def test_a_client_that_takes_nothing_of_its_stream_is_cut_off() -> None:
    rig = PageRig(web_settings(*(f"pump-{n}" for n in range(2000))))
    async with served(rig) as (_, server, port):
        sock = socket.socket()
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
        sock.setblocking(False)
        loop = asyncio.get_running_loop()
        await loop.sock_connect(sock, ("127.0.0.1", port))
        await loop.sock_sendall(sock, request("GET", "/api/v1/events", port=port))
        for n in range(200):
            rig.clock.s += 10.0  # with a beat each time
            for k in range(2000):
                rig.value(f"pump-{k}", "current", float(n))
            await asyncio.sleep(0.02)
            if n > 20 and not server._connections and not len(rig.streams):
                break
        sock.close()

        assert not server._connections
        assert len(rig.streams) == 0


async def test_more_connections_than_there_may_be_are_refused_and_idle_ones_make_room() -> None:
    async with served() as (_, server, port):
        many = [await asyncio.open_connection("127.0.0.1", port) for _ in range(3 * MOST_CONNECTIONS)]
        await asyncio.sleep(0.2)

        assert len(server._connections) <= MOST_CONNECTIONS
        assert await is_well(port), "a new client gets in while others only hold connections"
        for _, writer in many:
            writer.close()


async def test_the_end_of_the_server_ends_open_streams_within_a_moment() -> None:
    rig = PageRig()
    async with served(rig) as (_, _, port):
        reader, writer = await asyncio.open_connection("127.0.0.1", port, limit=2**22)
        writer.write(request("GET", "/api/v1/events", port=port))
        assert b" 200 " in await reader.readuntil(b"event: snapshot\n")
        began_s = asyncio.get_running_loop().time()
    assert asyncio.get_running_loop().time() - began_s < 2.0
    with suppress(OSError):
        await asyncio.wait_for(reader.read(), 5.0)
    writer.close()


@pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl is not here")
async def test_the_end_of_the_server_cuts_off_a_client_that_never_answers_the_end_of_tls(
    tmp_path: Path,
) -> None:
    certificate = Certificate.make(tmp_path)
    trusting = ssl.create_default_context(cafile=certificate.cert)

    def asked(port: int) -> ssl.SSLSocket:
        client = trusting.wrap_socket(
            socket.create_connection(("127.0.0.1", port)), server_hostname="localhost"
        )
        client.sendall(request("GET", "/api/v1/state", port=port, headers={"Connection": "close"}))
        assert client.recv(1) == b"H"
        return client

    async with served(certificate=certificate) as (_, server, port):
        client = await asyncio.to_thread(asked, port)
        await until(lambda: [each.transport.is_closing() for each in server._connections] == [True])

    with socket.socket(fileno=client.detach()) as raw:
        raw.settimeout(5.0)
        with suppress(ConnectionResetError):
            while await asyncio.to_thread(raw.recv, 65536):
                pass
