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

START = b"\x01\x06\x13\x8b\x00\x01 start"


@asynccontextmanager
async def connected() -> AsyncIterator[tuple[SocketPort, socket.socket]]:
    """Give a port, and the server's side of its connection, which takes little that it does not read."""
    listening = socket.socket()
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    listening.bind(("127.0.0.1", 0))
    listening.listen()
    listening.setblocking(False)
    accepting = asyncio.create_task(asyncio.get_running_loop().sock_accept(listening))
    port = await opener(f"socket://127.0.0.1:{listening.getsockname()[1]}")()
    assert isinstance(port, SocketPort)
    server, _ = await accepting
    server.setblocking(False)
    try:
        yield port, server
    finally:
        await settled(port)
        server.close()
        listening.close()


def socket_of(port: SocketPort) -> socket.socket:
    made: socket.socket = port._transport.get_extra_info("socket")._sock  # type: ignore[union-attr] # open
    return made


async def drain(server: socket.socket) -> bytes:
    """Return what arrives until the connection is reset."""
    received = b""
    with suppress(ConnectionResetError):
        async with asyncio.timeout(LONG_S):
            while chunk := await asyncio.get_running_loop().sock_recv(server, 4096):
                received += chunk
            raise AssertionError("closed in order")
    return received


async def test_a_socket_carries_bytes_both_ways_until_the_other_side_closes() -> None:
    async with connected() as (port, server):
        port.write(b"request")
        assert await asyncio.get_running_loop().sock_recv(server, 7) == b"request"
        server.send(b"reply")
        assert await read(port, 5) == b"reply"

        server.close()

        with pytest.raises(PortLostError, match="closed by the other side"):
            await port.read(until_s=asyncio.get_running_loop().time() + LONG_S)


async def test_a_write_that_stands_still_in_the_connection_never_arrives_after_a_reset() -> None:
    async with connected() as (port, server):
        connection, filled = socket_of(port), 0
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4096)
        with suppress(BlockingIOError):
            while True:
                filled += connection.send(b"." * 1024)
        connection.setsockopt(
            socket.SOL_SOCKET, socket.SO_SNDBUF, 65536
        )  # there is room again, but only here
        port.write(START)

        port.reset()
        await port.wait_closed()
        received = await drain(server)

    assert START not in received
    assert 0 < len(received) <= filled


async def test_a_closed_connection_is_reset_and_gives_up_what_is_not_acknowledged_within_2_s() -> None:
    async with connected() as (port, server):
        lingers = socket_of(port).getsockopt(socket.SOL_SOCKET, socket.SO_LINGER, 8)
        unacknowledged_ms = socket_of(port).getsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT)
        await settled(port)
        assert await drain(server) == b""

    assert struct.unpack("ii", lingers) == (1, 0)
    assert unacknowledged_ms == 2000
