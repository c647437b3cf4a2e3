"""`scan` as a process on ports that no process, a simulator or another program serves."""

from __future__ import annotations

import asyncio
import fcntl
import os
import re
import sys
import tty
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager, suppress

ALL_SETTINGS = 24


async def scanned(port: str, *options: str) -> tuple[int, str, str]:
    """Run `scan` to its end and return its exit code, its output and its messages."""
    process = await asyncio.create_subprocess_exec(
        sys.executable,
        "-m",
        "gateway",
        "scan",
        port,
        "--reply-within",
        "0.005",
        *options,
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
    )
    async with asyncio.timeout(60.0):
        out, errors = await process.communicate()
    return process.returncode or 0, out.decode(), errors.decode()


@contextmanager
def silent_tty() -> Iterator[str]:
    """Give the path of a port where no device answers."""
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    try:
        yield os.ttyname(theirs)
    finally:
        os.close(ours)
        os.close(theirs)


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
        code, _, errors = await scanned(url, "--address", "7")

    assert (code, "no starter was found" in errors) == (1, True)
    assert sum(received) == 8 * ALL_SETTINGS


async def test_a_port_that_another_program_holds_is_named_as_busy_in_one_line() -> None:
    with silent_tty() as port:
        held = os.open(port, os.O_RDWR | os.O_NOCTTY)
        fcntl.flock(held, fcntl.LOCK_EX)
        code, _, errors = await scanned(port, "--address", "1")
        os.close(held)

    assert code == 1
    assert re.fullmatch(rf"starter-gateway: port {port}: busy \(.*\)\n", errors)
