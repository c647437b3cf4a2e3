"""An HTTP client of the tests' own: what it sends is written byte for byte."""

from __future__ import annotations

import asyncio
from contextlib import suppress


async def exchange(port: int, data: bytes, *, within_s: float = 15.0) -> int:
    """Send bytes and return the status of the answer; 0: the connection was ended without one."""
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    try:
        async with asyncio.timeout(within_s):
            with suppress(ConnectionError):
                writer.write(data)
                await writer.drain()
            return await read_status(reader)
    finally:
        writer.close()
        with suppress(OSError):
            await writer.wait_closed()


async def read_status(reader: asyncio.StreamReader) -> int:
    try:
        return int((await reader.readuntil(b"\r\n\r\n")).split()[1])
    except (asyncio.IncompleteReadError, ConnectionError):
        return 0


def request(
    method: str, path: str, body: bytes = b"", *, port: int = 0, headers: dict[str, str] | None = None
) -> bytes:
    """Return a request as a browser would write it."""
    fields = {"Host": f"127.0.0.1:{port}", **(headers or {})}
    if method == "POST":
        usual = {"Origin": f"http://127.0.0.1:{port}", "Content-Type": "application/json"}
        fields = {**usual, "Content-Length": str(len(body)), **fields}
    lines = [f"{method} {path} HTTP/1.1", *(f"{name}: {value}" for name, value in fields.items())]
    return "\r\n".join(lines).encode("latin-1") + b"\r\n\r\n" + body
