"""What waits for the broker outlives SIGKILL."""

from __future__ import annotations

import random
from pathlib import Path

from gateway.store import STATE_FILE, Connection, OutboxRow, OutboxTable, Rank
from gateway.store.database import read_file
from gateway.store.schema import STATE
from tests.end_to_end.killed_writer import write_until_killed

KILLS = 12
LONGEST_S = 0.15


def texts_of(folder: Path) -> list[str]:
    """Return what is in the file, in its order; it must open without anything being put aside."""

    def rows(connection: Connection) -> list[OutboxRow]:
        table, found = OutboxTable(), []
        for rank in (Rank.VALUE, Rank.EVENT):
            page = table.page(connection, rank, after=-(2**40), limit=10**6)
            assert not page.damaged
            found += page.rows
        return sorted(found)

    texts = [row.payload.decode() for row in read_file(folder / STATE_FILE, STATE, rows)]
    assert not list(folder.glob("*aside*"))
    return texts


def test_no_row_that_was_stored_is_lost_when_the_process_is_killed(tmp_path: Path) -> None:
    dice = random.Random(21)
    stored: list[str] = []
    for kill in range(KILLS):
        stored += write_until_killed("outbox_writer", tmp_path, kill, dice, LONGEST_S)

        found, published = texts_of(tmp_path), set(stored)

        assert len(found) == len(set(found))
        assert [text for text in found if text in published] == stored
    assert len(stored) > 20 * KILLS
