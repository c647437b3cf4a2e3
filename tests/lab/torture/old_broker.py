"""A broker of the old kind in front of a real one: it takes MQTT 3.1.1 only, and its line can be cut."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress

from tests.mosquitto import free_port

LEVEL_5 = 5  # the protocol level in CONNECT [MQTT5 3.1.2.2]
UNACCEPTABLE = b"\x20\x02\x00\x01"  # CONNACK: unacceptable protocol version [MQTT3.1.1 3.2.2.3]


class OldBroker:
    """Passes everything on, but refuses MQTT 5 as brokers do that do not know it."""

    def __init__(self, behind: int) -> None:
        self.port = free_port()
        self._behind = behind
        self._writers: set[asyncio.StreamWriter] = set()
        self._is_cut = False
        self.refused = 0  # attempts with MQTT 5

    @asynccontextmanager
    async def serving(self) -> AsyncIterator[OldBroker]:
        server = await asyncio.start_server(self._serve, "127.0.0.1", self.port)
        try:
            yield self
        finally:
            server.close()
            self.cut()

    def cut(self) -> None:
        """Drop every connection and take no new one."""
        self._is_cut = True
        for writer in tuple(self._writers):
            writer.transport.abort()

    def repair(self) -> None:
        """Take connections again."""
        self._is_cut = False

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._writers.add(writer)
        try:
            with suppress(OSError, asyncio.IncompleteReadError):
                if not self._is_cut:
                    await self._talk(reader, writer)
        finally:
            self._writers.discard(writer)
            writer.transport.abort()

    async def _talk(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        head = await reader.readexactly(1)
        while head[-1] & 0x80 or len(head) == 1:  # the remaining length
            head += await reader.readexactly(1)
        name = await reader.readexactly(7)  # length, "MQTT", level
        if name[-1] == LEVEL_5:
            self.refused += 1
            writer.write(UNACCEPTABLE)
            await writer.drain()
            return
        from_behind, behind = await asyncio.open_connection("127.0.0.1", self._behind)
        self._writers.add(behind)
        for each in (writer, behind):
            each.get_extra_info("socket").setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        behind.write(head + name)
        ways = {asyncio.create_task(_pass(reader, behind)), asyncio.create_task(_pass(from_behind, writer))}
        try:
            await asyncio.wait(ways, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for way in ways:
                way.cancel()
            await asyncio.gather(*ways, return_exceptions=True)
            self._writers.discard(behind)
            behind.transport.abort()


async def _pass(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    while chunk := await reader.read(65_536):
        writer.write(chunk)
        await writer.drain()
