"""What systemd is to a service: a socket that it is notified on."""

from __future__ import annotations

import asyncio
import socket
from pathlib import Path

UNUSED_PORT = 9  # a TCP port on which no process listens: no broker


class ServiceManager:
    """Listens on a notification socket [sd_notify(3)]."""

    def __init__(self, path: Path) -> None:
        self.address = str(path)
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(self.address)
        self._socket.setblocking(False)

    async def receives(self, word: str, *, within_s: float = 20.0) -> None:
        loop = asyncio.get_running_loop()
        async with asyncio.timeout(within_s):
            while word not in (await loop.sock_recv(self._socket, 4096)).decode().splitlines():
                pass

    def close(self) -> None:
        self._socket.close()
