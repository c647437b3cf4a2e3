from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from gateway.errors import DamagedError
from gateway.storage.database import Connection, Database
from gateway.storage.ledger_table import LedgerRow, LedgerTable

ROW = LedgerRow(
    client="alice",
    id="1",
    starter="pump-1",
    verb="start",
    phase="accepted",
    code="ok",
    text="accepted",
    time_s=10.0,
    extra="{}",
    is_final=0,
    may_be_written=0,
    since_s=10.0,
)


class Stored:
    """A table in a database of its own, used without a thread."""

    def __init__(self, folder: Path, table: LedgerTable) -> None:
        self.table = table
        self.database = Database(folder / "x.sqlite", [table], 2**20)
        self.database.open()

    def put(self, *rows: LedgerRow) -> None:
        for row in rows:

            def work(connection: Connection, row: LedgerRow = row) -> None:
                self.table.put(connection, row=row)

            self.database.transact([work])

    def forget(self, *keys: tuple[str, str]) -> None:
        self.database.transact([lambda connection: self.table.forget(connection, keys=keys)])

    def rows(self) -> list[LedgerRow]:
        (rows,) = self.database.transact([self.table.rows])
        return list(rows)

    def ids(self) -> list[str]:
        return [row.id for row in self.rows()]


@pytest.fixture
def stored(tmp_path: Path) -> Iterator[Stored]:
    stored = Stored(tmp_path, LedgerTable())
    yield stored
    stored.database.close()


def final(id_: str, since_s: float = 10.0) -> LedgerRow:
    return replace(ROW, id=id_, phase="confirmed", is_final=1, since_s=since_s)


@pytest.mark.parametrize("since_s", [-1.0e9, 10.0, 1.8e9])
def test_no_row_goes_by_itself_whatever_the_clock_says_and_however_many_there_are(
    stored: Stored, since_s: float
) -> None:
    stored.put(*(final(str(number), since_s=since_s) for number in range(300)))

    assert stored.ids() == [str(number) for number in range(300)]


def test_room_is_made_from_what_may_be_repeated_and_what_was_acted_on_keeps_its_key(stored: Stored) -> None:
    harmless = [replace(final(f"no {n}"), phase="rejected") for n in range(9)]
    harmless.append(replace(final("read"), verb="read"))
    acted = replace(final("acted"), text="x" * 500, extra='{"values": 5}')
    stored.put(replace(ROW, id="under way"), acted, *harmless)

    stored.database.make_room()
    assert stored.ids() == ["under way", "acted", "no 6", "no 7", "no 8", "read"]
    for _ in range(4):
        stored.database.make_room()

    assert stored.ids() == ["under way", "acted"]
    row = stored.rows()[1]
    assert (row.extra, len(row.text), row.phase) == ("{}", 40, "confirmed")


@pytest.mark.parametrize("column", ["time_s", "since_s"])
def test_a_row_that_has_lost_its_shape_is_damage(stored: Stored, column: str) -> None:
    stored.put(ROW)

    stored.database.transact([lambda connection: connection.execute(f"UPDATE ledger SET {column} = 'x'")])

    with pytest.raises(DamagedError):
        stored.rows()
