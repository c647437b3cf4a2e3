"""What waits for the broker outlives SIGKILL."""

from __future__ import annotations

import random
from pathlib import Path

from gateway.storage.database import Database
from gateway.storage.outbox import FILE
from gateway.storage.outbox_table import HIGHEST, OutboxTable
from gateway.storage.spool import Kind
from tests.end_to_end.killed_writer import write_until_killed

KILLS = 12
LONGEST_S = 0.15


def texts_of(folder: Path) -> list[str]:
    """Return what is in the file, in its order; it must open without anything being put aside."""
    table = OutboxTable()
    database = Database(folder / FILE, [table], 2**26)
    assert database.open() == ""
    rows = []
    for kind in (Kind.VALUE, Kind.EVENT):
        (page,) = database.transact(
            [lambda c, k=kind: table.page(c, kind=k, after=-1, before=HIGHEST, most=10**6)]
        )
        assert page.losses == ()
        rows += page.rows
    database.close()
    return [row.payload.decode() for row in sorted(rows)]


def test_no_row_that_was_stored_is_lost_when_the_process_is_killed(tmp_path: Path) -> None:
    dice = random.Random(21)
    stored: list[str] = []
    for kill in range(KILLS):
        stored += write_until_killed("outbox_writer", tmp_path, kill, dice, LONGEST_S)

        found, published = texts_of(tmp_path), set(stored)

        assert len(found) == len(set(found))
        assert [text for text in found if text in published] == stored
    assert len(stored) > 20 * KILLS
