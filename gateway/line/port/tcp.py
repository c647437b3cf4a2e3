"""A serial server over TCP: connected to, and read and written as a port."""

from __future__ import annotations

import asyncio
import socket
import struct
from typing import cast
from urllib.parse import urlsplit

from gateway.errors import PortError, PortLostError
from gateway.line.port.buffered import OpenPort

CONNECT_LIMIT_S = 5.0  # for the other side to accept a connection
SCHEME = "socket"

_KEEP_ALIVE = (  # a serial server that was switched off is noticed within about 30 s
    (socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1),
    (socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, 10),
    (socket.IPPROTO_TCP, socket.TCP_KEEPINTVL, 5),
    (socket.IPPROTO_TCP, socket.TCP_KEEPCNT, 4),
)
# Unsent bytes of a closed connection are dropped (RST), and what the other side's kernel has not acknowledged
# after so long is too [tcp(7)]: no frame is to arrive when it has long been given up.
_NO_LINGER = struct.pack("ii", 1, 0)
_UNACKNOWLEDGED_MS = 2000
_NOTHING_LATE: tuple[tuple[int, int, int | bytes], ...] = (
    (socket.SOL_SOCKET, socket.SO_LINGER, _NO_LINGER),
    (socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, _UNACKNOWLEDGED_MS),
    (socket.IPPROTO_TCP, socket.TCP_NODELAY, 1),
)
_OPTIONS = (*_KEEP_ALIVE, *_NOTHING_LATE)


class SocketPort(OpenPort):
    """A TCP connection to a serial server."""

    def write(self, frame: bytes) -> None:
        """Hand one whole frame to the connection; raise PortLostError when it is gone or stuck."""
        if self._lost is not None:
            raise PortLostError(self._name, self._lost)
        self.hold()
        transport = cast(asyncio.Transport, self._transport)
        if transport.get_write_buffer_size() > 0:
            raise PortLostError(self._name, "stuck: accepts no further bytes", "restart the serial server")
        transport.write(frame)

    def reset(self) -> None:
        """Close the connection; SO_LINGER is set, so that this drops what has not left yet."""
        self.close()

    def data_received(self, data: bytes) -> None:
        """Take bytes; asyncio calls this."""
        self._take(data, self._time())
        if len(self._received) >= self._wanted:
            self._wake()

    def _look_once(self) -> None:
        """Leave it to the transport: the next wait reads bytes of the last moment."""


async def connect(name: str) -> SocketPort:
    """Connect to socket://host:port; PortError with the reason and a hint when that cannot be done."""
    host, number = socket_address(name)
    port = SocketPort(name)
    loop = asyncio.get_running_loop()
    try:
        async with asyncio.timeout(CONNECT_LIMIT_S):
            transport, _ = await loop.create_connection(lambda: port, host, number)
    except TimeoutError as error:
        raise PortError(name, f"no connection within {CONNECT_LIMIT_S:g} s") from error
    except OSError as error:
        raise PortError(name, error.strerror or str(error), "is the serial server on?") from error
    connection = transport.get_extra_info("socket")
    for level, option, setting in _OPTIONS:
        connection.setsockopt(level, option, setting)
    return port


def socket_address(name: str) -> tuple[str, int]:
    """Return host and port of socket://host:port; PortError for anything else."""
    wrong = PortError(name, "not an address", "write socket://host:port")
    try:
        url = urlsplit(name)
        host, number = url.hostname, url.port
    except ValueError as error:
        raise wrong from error
    if url.scheme != SCHEME or not host or not number:
        raise wrong
    return host, number
