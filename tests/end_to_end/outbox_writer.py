"""Writes rows of an outbox as fast as it can, and prints each stored one: a process to be killed."""

from __future__ import annotations

import os
import sys
from functools import partial
from pathlib import Path

from gateway.store import STATE_FILE, OutboxRow, OutboxTable, Rank, Store
from gateway.store.schema import STATE

AT_ONCE = 20


def write(folder: Path, run: str) -> None:
    """Write events and values `<run>-<number>` until killed, not all of them flushed."""
    store, table = Store(folder / STATE_FILE, STATE), OutboxTable()
    store.start(lambda *_: None)
    number = 0
    while True:
        rows = [_row(number + more, run) for more in range(1, AT_ONCE + 1)]
        number += AT_ONCE
        store.submit(partial(table.insert, rows=rows), is_flushed=number % 3 == 0).result()
        # One piece that no kill can take along or cut.
        os.write(1, "".join(f"{row.payload.decode()}\n" for row in rows).encode())


def _row(number: int, run: str) -> OutboxRow:
    rank = Rank.VALUE if number % 2 else Rank.EVENT
    return OutboxRow(number, rank, "b/event", f"{run}-{number}".encode(), 1.0, run, "")


if __name__ == "__main__":
    write(Path(sys.argv[1]), sys.argv[2])
