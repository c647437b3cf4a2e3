"""A line behind a socket://: the same as a tty, with its own ways to be lost."""

from __future__ import annotations

import asyncio
import socket
import struct
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress

import pytest

from gateway.errors import PortLostError
from gateway.line.port.tcp import SocketPort
from tests.line.opened import LONG_S, opener, read, settled


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


async def test_a_write_that_stands_still_in_the_connection_never_arrives_after_a_reset() -> None:
    async with stalled_server() as (url, accepted):
        port = await opener(url)()
        connection = await accepted
        assert isinstance(port, SocketPort)
        filled = fill(port)
        port.write(START)

        port.reset()
        await port.wait_closed()
        received = await drain(connection)

    assert START not in received
    assert 0 < len(received) <= filled


async def test_a_closed_connection_is_reset_and_gives_up_what_is_not_acknowledged_within_2_s() -> None:
    async with serial_server() as (url, peer):
        port = await opener(url)()
        reader, _ = await peer
        assert isinstance(port, SocketPort)
        connection = port._transport.get_extra_info("socket")  # type: ignore[union-attr] # it is open

        lingers = struct.unpack("ii", connection.getsockopt(socket.SOL_SOCKET, socket.SO_LINGER, 8))
        unacknowledged_ms = connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT)
        await settled(port)
        with pytest.raises(ConnectionResetError):
            await reader.read()

    assert lingers == (1, 0)
    assert unacknowledged_ms == 2000


START = b"\x01\x06\x13\x8b\x00\x01 start"


@asynccontextmanager
async def stalled_server() -> AsyncIterator[tuple[str, asyncio.Task[socket.socket]]]:
    """Give the URL of a server that takes a connection and reads nothing of it, and that connection."""
    listening = socket.socket()
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    listening.bind(("127.0.0.1", 0))
    listening.listen()
    listening.setblocking(False)
    loop = asyncio.get_running_loop()

    async def accept() -> socket.socket:
        return (await loop.sock_accept(listening))[0]

    accepting = loop.create_task(accept())
    try:
        yield f"socket://127.0.0.1:{listening.getsockname()[1]}", accepting
    finally:
        (await accepting).close()
        listening.close()


def fill(port: SocketPort) -> int:
    """Write until the way takes no more; return how much that was. What follows stays in our own kernel."""
    connection = port._transport.get_extra_info("socket")  # type: ignore[union-attr] # it is open
    connection = connection._sock  # asyncio shows it without `send`
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4096)
    filled = 0
    with suppress(BlockingIOError):
        while True:
            filled += connection.send(b"." * 1024)
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 65536)  # there is room again, but only here
    return filled


async def drain(connection: socket.socket) -> bytes:
    """Return what arrives until the connection is reset."""
    loop = asyncio.get_running_loop()
    received = b""
    with suppress(ConnectionResetError):
        async with asyncio.timeout(LONG_S):
            while chunk := await loop.sock_recv(connection, 4096):
                received += chunk
    return received
