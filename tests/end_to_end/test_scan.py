"""`scan` as a process; a port that another program holds: `tests/line/test_serial_port_opening.py`."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress

from tests.end_to_end.site import Program

ALL_SETTINGS = 24


@asynccontextmanager
async def serial_server() -> AsyncIterator[tuple[str, list[int]]]:
    """Give the URL of a serial server for one client at a time, and the bytes of each of its connections."""
    received: list[int] = []
    open_now = 0

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        nonlocal open_now
        if open_now:
            writer.close()
            return
        open_now += 1
        received.append(0)
        mine = len(received) - 1
        with suppress(ConnectionError):
            while data := await reader.read(100):
                received[mine] += len(data)
        await asyncio.sleep(0.05)  # it takes its time to notice
        open_now -= 1
        writer.close()

    server = await asyncio.start_server(serve, "127.0.0.1", 0)
    try:
        yield f"socket://127.0.0.1:{server.sockets[0].getsockname()[1]}", received
    finally:
        server.close()


async def test_every_setting_behind_a_serial_server_for_one_client_is_tried() -> None:
    async with serial_server() as (url, received):
        options = ("--reply-within", "0.005", "--address", "7")
        async with Program("gateway", "scan", url, *options) as scan:
            code = await scan.exit_code(within_s=60.0)

    assert (code, "no starter was found" in scan.output) == (1, True)
    assert sum(received) == 8 * ALL_SETTINGS
