"""Ports as tests open them, and the other end of a pty."""

from __future__ import annotations

import asyncio
import os
from dataclasses import dataclass

from gateway.line.port.base import Port
from gateway.line.port.opener import SerialOpener
from gateway.modbus.timing import Framing

FRAMING = Framing.parse("8E1")
LONG_S = 5.0


@dataclass
class Pty:
    master: int
    path: str

    def hang_up(self) -> None:
        os.close(self.master)
        self.master = -1


def opener(path: str, baud: int = 19200, framing: Framing = FRAMING) -> SerialOpener:
    return SerialOpener(path, baud, framing)


async def read(port: Port, size: int) -> bytes:
    """Read so many bytes, in whatever chunks."""
    until_s = asyncio.get_running_loop().time() + LONG_S
    received = b""
    while len(received) < size:
        chunk = await port.read(until_s=until_s)
        assert chunk, f"only {received!r} came"
        received += chunk
    return received


async def settled(port: Port) -> None:
    """Return once a closed port's descriptor is closed."""
    port.close()
    await port.wait_closed()  # type: ignore[attr-defined] # no part of Port


async def read_pty(pair: Pty, size: int) -> bytes:
    loop = asyncio.get_running_loop()
    received = b""
    while len(received) < size:
        ready = loop.create_future()
        loop.add_reader(pair.master, ready.set_result, None)
        await asyncio.wait_for(ready, LONG_S)
        loop.remove_reader(pair.master)
        received += os.read(pair.master, 4096)
    return received
