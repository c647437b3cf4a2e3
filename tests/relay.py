"""A TCP way between two programs on loopback that can be cut, or stand still with open connections."""

from __future__ import annotations

import asyncio
from contextlib import suppress


class Relay:
    """Hands bytes on between clients of `port`, the same over cuts, and the server on `target`."""

    def __init__(self, target: int) -> None:
        self.port = 0
        self.target = target
        self.received = bytearray()  # from the clients, also what was not handed on
        self._server: asyncio.Server | None = None
        self._writers: set[asyncio.StreamWriter] = set()
        self._tasks: set[asyncio.Task[None]] = set()
        self._moving = asyncio.Event()
        self._moving.set()

    async def __aenter__(self) -> Relay:
        await self.join()
        return self

    async def __aexit__(self, *_: object) -> None:
        await asyncio.sleep(0.05)  # in which the loop takes what had been accepted already
        self.cut()
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        await asyncio.sleep(0.05)  # in which the loop closes the transports

    def cut(self) -> None:
        """End every connection, what is under way is lost, and refuse new ones."""
        if self._server is not None:
            self._server.close()
            self._server = None
        for writer in list(self._writers):
            writer.transport.abort()

    def stall(self) -> None:
        """Hand nothing on until `join`; connections stay open, and what comes meanwhile waits."""
        self._moving.clear()

    async def join(self) -> None:
        """Hand on again, what waits first, and take connections."""
        self._moving.set()
        if self._server is None:
            self._server = await asyncio.start_server(self._accept, "127.0.0.1", self.port)
            self.port = self._server.sockets[0].getsockname()[1]

    def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.create_task(self._serve(reader, writer))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._writers.add(writer)
        with suppress(OSError):
            there, back = await asyncio.open_connection("127.0.0.1", self.target)
            self._writers.add(back)
            await asyncio.gather(self._hand_on(reader, back, is_up=True), self._hand_on(there, writer))
            self._writers.discard(back)
        self._writers.discard(writer)
        writer.transport.abort()

    async def _hand_on(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, *, is_up: bool = False
    ) -> None:
        try:
            with suppress(ConnectionError):
                while chunk := await reader.read(65536):
                    if is_up:
                        self.received += chunk
                    await self._moving.wait()
                    writer.write(chunk)
                    await writer.drain()
        finally:
            writer.close()
