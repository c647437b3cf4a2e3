"""Puts rows into an outbox's file as fast as it can, and prints each stored one: a process to be killed."""

from __future__ import annotations

import asyncio
import os
import sys
from pathlib import Path

from gateway.storage.outbox import OutboxDisk
from gateway.storage.spool import Changes, Kind, Row
from gateway.storage.worker import News

AT_ONCE = 20


async def write(folder: Path, run: str) -> None:
    """Put events and values `<run>-<number>` until killed, not all of them flushed."""
    disk = OutboxDisk(folder)
    is_open = asyncio.Event()

    def on_news(news: News, text: str) -> None:
        if news is not News.OPEN:
            os.write(1, f"{news}: {text}\n".encode())
        is_open.set()

    disk.start(on_news)
    await is_open.wait()
    await disk.recall()
    number = 0
    while True:
        rows = [_row(number + more, run) for more in range(1, AT_ONCE + 1)]
        number += AT_ONCE
        await disk.apply(Changes(tuple(rows), is_flushed=number % 3 == 0))
        # One piece that no kill can take along or cut.
        os.write(1, "".join(f"{row.payload.decode()}\n" for row in rows).encode())


def _row(number: int, run: str) -> Row:
    kind = Kind.VALUE if number % 2 else Kind.EVENT
    return Row(number, kind, run, "b/event", f"{run}-{number}".encode(), None, "", 1.0)


if __name__ == "__main__":
    asyncio.run(write(Path(sys.argv[1]), sys.argv[2]))
