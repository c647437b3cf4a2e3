"""An open serial server over TCP."""

from __future__ import annotations

import asyncio
from typing import cast

from gateway.errors import PortLostError
from gateway.line.port.buffered import OpenPort


class SocketPort(OpenPort):
    """A TCP connection to a serial server."""

    def write(self, frame: bytes) -> None:
        """Hand one whole frame to the connection; raise PortLostError when it is gone or stuck."""
        if self._lost is not None:
            raise PortLostError(self._name, self._lost)
        self.hold()
        transport = cast(asyncio.Transport, self._transport)
        if transport.get_write_buffer_size() > 0:
            raise PortLostError(self._name, "stuck: takes no more bytes", "restart the serial server")
        transport.write(frame)

    def reset(self) -> None:
        """Close the connection; the opener has set SO_LINGER so that this drops what has not left yet."""
        self.close()

    def data_received(self, data: bytes) -> None:
        """Take bytes; asyncio calls this."""
        self._take(data, self._time())
        if len(self._received) >= self._wanted:
            self._wake()

    def _look_once(self) -> None:
        """Leave it to the transport: what came in the last moment is read by the next wait."""
