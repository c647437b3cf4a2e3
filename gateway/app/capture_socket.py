"""Offers the lines' frames, as they pass, to programs on this machine: `starter-gateway capture`.

A Unix socket in the state directory that only the gateway's user may use. Each frame is one line of JSON; the
first line says which lines there are. Nothing is read from it, and nothing can be sent on a line through it.
"""

from __future__ import annotations

import asyncio
import json
import logging
import os
from collections.abc import Callable, Iterable
from pathlib import Path

from gateway.config import Config
from gateway.line import OnFrame
from gateway.system.clock import Clock

FORMAT = 1
MOST_UNSENT_BYTES = 1 << 20  # a reader that is slower is cut off: the gateway does not wait for it

log = logging.getLogger(__name__)


def socket_path(config: Config, folder: Path) -> Path:
    """Return where a gateway offers its frames; `folder` is the configuration's."""
    return folder / config.gateway.state_dir / f"{config.gateway.name}.capture"


class CaptureSocket:
    """Serves any number of readers; while there is none, no frame is touched.

    `capture` switches the lines' frames on and off.
    """

    def __init__(
        self,
        path: Path,
        lines: Iterable[str],
        capture: Callable[[OnFrame | None], None],
        clock: Clock,
    ) -> None:
        self._path = path
        self.lines = tuple(lines)  # as the first line of JSON names them
        self._capture = capture
        self._clock = clock
        self._readers: set[asyncio.StreamWriter] = set()

    async def run(self) -> None:
        """Serve until cancelled; when the socket cannot be made, log why and return."""
        try:
            server = await self._bound()
        except OSError as error:
            log.warning("no capture: %s: %s", self._path, error.strerror or error)
            return
        try:
            await server.start_serving()
            await asyncio.get_running_loop().create_future()
        finally:
            server.close()
            for reader in tuple(self._readers):
                reader.transport.abort()
            self._path.unlink(missing_ok=True)

    async def _bound(self) -> asyncio.Server:
        """Return a server at a socket for this user only, in place of one that an earlier process left."""
        self._path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        before = os.umask(0o177)  # nothing else runs meanwhile: without serving, the server is made at once
        try:
            return await asyncio.start_unix_server(self._serve, self._path, start_serving=False)
        finally:
            os.umask(before)

    async def _serve(self, received: asyncio.StreamReader, reader: asyncio.StreamWriter) -> None:
        _write(reader, {"capture": FORMAT, "lines": self.lines})
        self._readers.add(reader)
        if len(self._readers) == 1:
            self._capture(self._take)
        try:
            await received.read()  # nothing is expected; this ends when the reader goes
        except OSError:
            pass
        finally:
            self._readers.discard(reader)
            if not self._readers:
                self._capture(None)
            reader.close()

    def _take(self, line: str, at_s: float, direction: str, frame: bytes) -> None:
        time_us = round(self._clock.utc_s(at_s) * 1e6)
        row = {"line": line, "time_us": time_us, "direction": direction, "frame": frame.hex()}
        for reader in tuple(self._readers):
            _write(reader, row)
            if reader.transport.get_write_buffer_size() > MOST_UNSENT_BYTES:
                log.warning("a capture is too slow and is cut off")
                reader.transport.abort()


def _write(reader: asyncio.StreamWriter, what: dict[str, object]) -> None:
    reader.write(json.dumps(what).encode() + b"\n")
