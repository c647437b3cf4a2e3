"""An HTTP client of the tests' own: what it sends is written byte for byte."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any


@dataclass
class RawAnswer:
    """One answer as it came; status 0: the connection was ended without one."""

    status: int
    headers: dict[str, str] = field(default_factory=dict)
    body: bytes = b""

    @property
    def json(self) -> Any:
        return json.loads(self.body)


async def exchange(port: int, data: bytes, *, within_s: float = 15.0, host: str = "127.0.0.1") -> RawAnswer:
    """Send bytes and read one answer, or the end of the connection."""
    reader, writer = await asyncio.open_connection(host, port)
    try:
        async with asyncio.timeout(within_s):
            with suppress(ConnectionError):
                writer.write(data)
                await writer.drain()
            return await read_answer(reader)
    finally:
        writer.close()
        with suppress(OSError):
            await writer.wait_closed()


async def read_answer(reader: asyncio.StreamReader) -> RawAnswer:
    try:
        head = (await reader.readuntil(b"\r\n\r\n")).decode("latin-1").split("\r\n")
    except (asyncio.IncompleteReadError, ConnectionError):
        return RawAnswer(0)
    fields = (line.partition(": ") for line in head[1:] if line)
    headers = {name.lower(): value for name, _, value in fields}
    length = int(headers.get("content-length", 0))
    body = await reader.readexactly(length) if length else b""
    return RawAnswer(int(head[0].split()[1]), headers, body)


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


class WebClient:
    """A user of the page, with cookie and CSRF token."""

    def __init__(self, port: int) -> None:
        self.port = port
        self.patience_s = 15.0
        self.headers: dict[str, str] = {"Sec-Fetch-Site": "same-origin"}

    async def get(self, path: str) -> RawAnswer:
        return await exchange(self.port, request("GET", path, port=self.port, headers=self.headers))

    async def post(self, path: str, fields: object = None, **headers: str) -> RawAnswer:
        body = json.dumps(fields or {}).encode()
        sent = {**self.headers, **headers}
        data = request("POST", path, body, port=self.port, headers=sent)
        return await exchange(self.port, data, within_s=self.patience_s)

    async def log_in(self, user: str, password: str) -> RawAnswer:
        answer = await self.post("/api/v1/login", {"user": user, "password": password})
        if answer.status == 200:
            self.headers["Cookie"] = answer.headers["set-cookie"].split(";")[0]
            self.headers["X-CSRF-Token"] = answer.json["csrf"]
        return answer

    async def events(self, path: str = "/api/v1/events") -> AsyncIterator[tuple[str, Any]]:
        """Yield the stream's events until it ends."""
        reader, writer = await asyncio.open_connection("127.0.0.1", self.port, limit=2**22)
        try:
            writer.write(request("GET", path, port=self.port, headers=self.headers))
            head = await reader.readuntil(b"\r\n\r\n")
            assert b" 200 " in head, head
            buffer = b""
            while (size := int(await reader.readuntil(b"\r\n"), 16)) > 0:
                buffer += (await reader.readexactly(size + 2))[:-2]
                *whole, buffer = buffer.split(b"\n\n")
                for text in whole:
                    name, _, data = text.decode().partition("\ndata: ")
                    if name.startswith("event: "):
                        yield name[7:], json.loads(data)
        finally:
            writer.close()
            with suppress(OSError):
                await writer.wait_closed()
