"""A line behind a socket://: the same as a tty, with its own ways to be lost."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import pytest

from gateway.errors import PortError, PortLostError
from gateway.line import serial_port
from tests.line.opened import LONG_S, opener, read, settled, write_often


@asynccontextmanager
async def serial_server() -> AsyncIterator[
    tuple[str, asyncio.Future[tuple[asyncio.StreamReader, asyncio.StreamWriter]]]
]:
    """Give the URL of a TCP server and, later, its side of the first connection."""
    peer: asyncio.Future[tuple[asyncio.StreamReader, asyncio.StreamWriter]] = (
        asyncio.get_running_loop().create_future()
    )

    def accept(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        peer.set_result((reader, writer))

    server = await asyncio.start_server(accept, "127.0.0.1", 0)
    try:
        yield f"socket://127.0.0.1:{server.sockets[0].getsockname()[1]}", peer
    finally:
        if peer.done():
            peer.result()[1].close()
        server.close()
        await server.wait_closed()


async def test_a_socket_carries_bytes_both_ways_until_the_other_side_closes() -> None:
    async with serial_server() as (url, peer):
        port = await opener(url)()
        reader, writer = await peer

        port.write(b"request")
        assert await reader.readexactly(7) == b"request"
        writer.write(b"reply")
        assert await read(port, 5) == b"reply"

        writer.close()
        with pytest.raises(PortLostError, match="closed by the other side"):
            await port.read(until_s=asyncio.get_running_loop().time() + LONG_S)
        await settled(port)


async def test_a_socket_that_takes_no_more_bytes_is_lost_instead_of_waited_for() -> None:
    async with serial_server() as (url, peer):
        port = await opener(url)()
        await peer

        with pytest.raises(PortLostError, match="stuck"):
            write_often(port, bytes(65536))

        await settled(port)


async def test_a_refused_connection_is_told() -> None:
    async with serial_server() as (url, _):
        pass

    with pytest.raises(PortError, match="is the serial server on"):
        await opener(url)()


async def test_a_connection_that_nobody_accepts_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    async def never(*_: object) -> None:
        await asyncio.Event().wait()

    monkeypatch.setattr(asyncio.get_running_loop(), "create_connection", never)
    monkeypatch.setattr(serial_port, "OPEN_LIMIT_S", 0.01)

    with pytest.raises(PortError, match="no connection within"):
        await opener("socket://192.0.2.1:502")()
