"""A network between browser and gateway that can be cut: connections stay open, and nothing comes through."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from urllib.parse import urlsplit


class Relay:
    """Hands bytes on between its clients and a server, until it is cut."""

    def __init__(self, target: int) -> None:
        self.received = bytearray()  # from the clients, also what was not handed on
        self._target = target
        self._open = asyncio.Event()
        self._open.set()
        self._tasks: set[asyncio.Task[None]] = set()

    def cut(self) -> None:
        """Hand nothing on from now on."""
        self._open.clear()

    def join(self) -> None:
        """Hand on again, what waits first."""
        self._open.set()

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Serve one client."""
        self._tasks.add(asyncio.current_task())  # type: ignore[arg-type]
        there, back = await asyncio.open_connection("127.0.0.1", self._target)
        try:
            with suppress(ConnectionError):
                await asyncio.gather(self._hand_on(reader, back, is_noted=True), self._hand_on(there, writer))
        finally:
            back.close()
            writer.close()

    async def _hand_on(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, *, is_noted: bool = False
    ) -> None:
        while chunk := await reader.read(65536):
            if is_noted:
                self.received += chunk
            await self._open.wait()
            writer.write(chunk)
            await writer.drain()
        writer.close()

    async def end(self) -> None:
        """End every connection."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        await asyncio.sleep(0)  # then the loop closes the transports


@asynccontextmanager
async def relayed(url: str) -> AsyncIterator[tuple[str, Relay]]:
    """Yield the address of a relay to a page, and the relay."""
    relay = Relay(urlsplit(url).port or 0)
    server = await asyncio.start_server(relay.serve, "127.0.0.1", 0)
    port = server.sockets[0].getsockname()[1]
    try:
        yield f"http://127.0.0.1:{port}/", relay
    finally:
        server.close()
        await relay.end()
