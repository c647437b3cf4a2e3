"""Writes ledger rows as fast as it can, and prints each one that is on the disk: a process to be killed."""

from __future__ import annotations

import os
import sys
from concurrent.futures import Future
from functools import partial
from pathlib import Path

from gateway.storage.ledger_table import LedgerRow, LedgerTable
from gateway.storage.worker import News, Store

AT_ONCE = 20  # rows that wait for the disk at the same time


def main(path: str, run: str) -> None:
    """Write rows `<run>-<number>` until killed."""
    table = LedgerTable()
    store = Store(Path(path), [table])
    store.start(_report)
    number = 0
    while True:
        rows = [_row(f"{run}-{number + offset}") for offset in range(AT_ONCE)]
        number += AT_ONCE
        futures = [store.submit(partial(table.put, row=row)) for row in rows]
        for row, future in zip(rows, futures, strict=True):
            future.add_done_callback(partial(_acknowledge, row.id))
        futures[-1].result()


def _row(id_: str) -> LedgerRow:
    return LedgerRow(
        client="alice",
        id=id_,
        starter="pump-1",
        verb="start",
        phase="accepted",
        code="ok",
        text="accepted",
        time_s=1.0,
        extra="{}",
        is_final=0,
        may_be_written=1,
        since_s=1.0,
    )


def _acknowledge(id_: str, future: Future[None]) -> None:
    future.result()
    os.write(1, f"{id_}\n".encode())  # no buffer that a kill could take along


def _report(news: News, text: str) -> None:
    if news is not News.OPEN:
        os.write(1, f"{news}: {text}\n".encode())


if __name__ == "__main__":
    main(*sys.argv[1:])
