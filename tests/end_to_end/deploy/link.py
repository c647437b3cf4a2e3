"""A network between two brokers that can be severed, with its connections, or stand still with them open."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress


class Link:
    """Hands bytes on between clients and the server on `target`."""

    def __init__(self, target: int) -> None:
        self.port = 0
        self.target = target
        self._server: asyncio.Server | None = None
        self._moving = asyncio.Event()
        self._moving.set()
        self._writers: set[asyncio.StreamWriter] = set()
        self._tasks: set[asyncio.Task[None]] = set()

    async def begin(self) -> None:
        """Take connections, on the same port as before."""
        self._server = await asyncio.start_server(self.accept, "127.0.0.1", self.port)
        self.port = self._server.sockets[0].getsockname()[1]

    def sever(self) -> None:
        """End every connection and refuse new ones, until `restore`."""
        assert self._server is not None
        self._server.close()
        for writer in list(self._writers):
            writer.transport.abort()

    def stall(self) -> None:
        """Hand nothing on until `restore`; connections stay open, and what comes meanwhile waits."""
        self._moving.clear()

    async def restore(self) -> None:
        """Hand on again, what waits first."""
        self._moving.set()
        assert self._server is not None
        if not self._server.is_serving():
            await self.begin()

    def accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Serve one client, in a task of its own."""
        self._writers.add(writer)
        self._tasks.add(asyncio.create_task(self._serve(reader, writer)))

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        there, back = await asyncio.open_connection("127.0.0.1", self.target)
        self._writers.add(back)
        await asyncio.gather(self._hand_on(reader, back), self._hand_on(there, writer))
        self._writers -= {writer, back}

    async def _hand_on(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with suppress(ConnectionError):
            while chunk := await reader.read(65536):
                await self._moving.wait()
                writer.write(chunk)
                await writer.drain()
        writer.close()

    async def end(self) -> None:
        """End everything."""
        await asyncio.sleep(0.05)  # in which the loop takes what had been accepted already
        self.sever()
        for task in self._tasks:
            task.cancel()
        if self._tasks:
            await asyncio.wait(self._tasks, timeout=5.0)
        for writer in self._writers:
            writer.transport.abort()
        await asyncio.sleep(0.05)  # in which the loop closes them


@asynccontextmanager
async def linked(target: int) -> AsyncIterator[Link]:
    """Yield a link to a server on loopback."""
    link = Link(target)
    await link.begin()
    try:
        yield link
    finally:
        await link.end()
