"""A TCP relay whose two directions can stand still: nothing is lost, all of it comes when they go on."""

from __future__ import annotations

import asyncio
import contextlib
from types import TracebackType


class StallingRelay:
    """Between clients and a broker on loopback."""

    def __init__(self, broker_port: int) -> None:
        self._broker_port = broker_port
        self._up, self._down = asyncio.Event(), asyncio.Event()  # to the broker, from the broker
        self._up.set()
        self._down.set()
        self._copying: set[asyncio.Task[None]] = set()
        self.port = 0

    async def __aenter__(self) -> StallingRelay:
        self._server = await asyncio.start_server(self._serve, "127.0.0.1", 0)
        self.port = self._server.sockets[0].getsockname()[1]
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._server.close()
        for task in self._copying:
            task.cancel()
        await asyncio.gather(*self._copying, return_exceptions=True)

    def stall(self, *, up: bool = False, down: bool = False) -> None:
        """Let nothing more through to the broker (up), or from it (down), until `go_on`."""
        for stalled, event in ((up, self._up), (down, self._down)):
            if stalled:
                event.clear()

    def go_on(self) -> None:
        self._up.set()
        self._down.set()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        broker_reader, broker_writer = await asyncio.open_connection("127.0.0.1", self._broker_port)
        for source, sink, gate in ((reader, broker_writer, self._up), (broker_reader, writer, self._down)):
            task = asyncio.create_task(_copy(source, sink, gate))
            self._copying.add(task)
            task.add_done_callback(self._copying.discard)


async def _copy(source: asyncio.StreamReader, sink: asyncio.StreamWriter, gate: asyncio.Event) -> None:
    try:
        with contextlib.suppress(ConnectionError):
            while data := await source.read(65536):
                await gate.wait()
                sink.write(data)
    finally:
        sink.close()
