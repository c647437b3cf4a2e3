"""What SIGKILL leaves behind."""

from __future__ import annotations

import random
from pathlib import Path

from gateway.storage.database import Database
from gateway.storage.ledger_table import LedgerTable
from tests.end_to_end.killed_writer import write_until_killed

KILLS = 20
LONGEST_S = 0.15


def rows_of(path: Path) -> list[str]:
    """Return the ids in the ledger; it must have opened without putting anything aside."""
    table = LedgerTable()
    database = Database(path, [table], 2**26)
    assert database.open() == ""
    (rows,) = database.transact([table.rows])
    database.close()
    return [row.id for row in rows]


def test_no_acknowledged_row_is_lost_when_the_process_is_killed(tmp_path: Path) -> None:
    dice = random.Random(20)
    path = tmp_path / "x.sqlite"
    acknowledged: list[str] = []
    for kill in range(KILLS):
        acknowledged += write_until_killed("ledger_writer", path, kill, dice, LONGEST_S)

        stored = rows_of(path)

        assert len(stored) == len(set(stored))
        assert set(acknowledged) <= set(stored)
    assert len(acknowledged) > 20 * KILLS
