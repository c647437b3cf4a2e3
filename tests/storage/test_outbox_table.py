"""The outbox's tables in a file of their own, without a thread."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar

import pytest

from gateway.errors import DamagedError
from gateway.storage.database import Connection, Database
from gateway.storage.outbox_table import DAMAGED, FULL, HIGHEST, OutboxTable
from gateway.storage.spool import Changes, Kind, Loss, Page, Row

T = TypeVar("T")


def row(number: int, kind: Kind = Kind.EVENT, **more: Any) -> Row:
    fields: dict[str, Any] = {
        "boot": "run",
        "topic": "b/event",
        "payload": b'{"seq":1}',
        "correlation": None,
        "key": "",
        "time_s": float(number),
        **more,
    }
    return Row(number, kind, **fields)


class Stored:
    """A table in a database of its own."""

    def __init__(self, folder: Path, table: OutboxTable) -> None:
        self.table = table
        self.database = Database(folder / "x.sqlite", [table], 2**20)
        self.database.open()

    def do(self, work: Callable[[Connection], T]) -> T:
        (answer,) = self.database.transact([work])
        return answer  # type: ignore[no-any-return]  # of the one piece of work

    def apply(self, *rows: Row, **changes: Any) -> tuple[Loss, ...]:
        return self.do(lambda connection: self.table.apply(connection, Changes(rows, **changes)))

    def page(self, kind: Kind, after: int = -1, before: int = 100, most: int = 50) -> Page:
        return self.do(lambda c: self.table.page(c, kind=kind, after=after, before=before, most=most))

    def numbers(self, kind: Kind) -> list[int]:
        return [each.number for each in self.page(kind, before=HIGHEST, most=10_000).rows]

    def execute(self, sql: str) -> None:
        self.do(lambda connection: connection.execute(sql) and None)


@pytest.fixture
def stored(tmp_path: Path) -> Iterator[Stored]:
    stored = Stored(tmp_path, OutboxTable(most_rows=100))
    yield stored
    stored.database.close()


def test_a_full_file_makes_room_and_reports_once_what_it_cost(stored: Stored) -> None:
    stored.apply(*(row(number, Kind.VALUE) for number in range(50)))

    stored.database.make_room()

    assert stored.table.take_made_room() == (Loss(FULL, Kind.VALUE, 6, 0.0, 5.0, 5),)
    assert stored.table.take_made_room() == ()
    assert stored.numbers(Kind.VALUE) == list(range(6, 50))
    assert stored.do(stored.table.recall)[1].losses == (Loss(FULL, Kind.VALUE, 6, 0.0, 5.0),)


def test_room_is_made_in_an_empty_file_too(stored: Stored) -> None:
    stored.database.make_room()

    assert stored.table.take_made_room() == ()


@pytest.mark.parametrize(
    "damage",
    ["payload = x'00'", "topic = 'b/#'", "time_s = 'soon'", "boot = 7", "checksum = 0", "correlation = 1.5"],
)
def test_a_damaged_row_is_never_reported_but_declared(stored: Stored, damage: str) -> None:
    stored.apply(row(1), row(2), row(3))
    stored.execute(f"UPDATE spool SET {damage} WHERE number = 2")

    page = stored.page(Kind.EVENT)

    assert page == Page((row(1), row(3)), is_last=True, losses=(Loss(DAMAGED, Kind.EVENT, 1, None, None),))
    assert stored.page(Kind.EVENT) == Page((row(1), row(3)), is_last=True)
    assert stored.do(stored.table.recall)[1].losses == page.losses


@pytest.mark.parametrize("number", ["'last'", "-5", str(2**61)])
def test_numbers_that_make_no_sense_are_damage(stored: Stored, number: str) -> None:
    stored.execute("CREATE TABLE spool2 AS SELECT * FROM spool")
    stored.execute("DROP TABLE spool")
    stored.execute("ALTER TABLE spool2 RENAME TO spool")
    stored.execute(f"INSERT INTO spool VALUES (1, {number}, '', '', x'', NULL, '', 1.0, 0)")

    with pytest.raises(DamagedError):
        stored.do(stored.table.recall)


def test_times_and_losses_that_make_no_sense_are_left_out(stored: Stored) -> None:
    stored.apply(row(1), losses=(Loss("x", Kind.VALUE, 2, 1.0, 1.0), Loss("y", Kind.EVENT, 2, 1.0, 1.0)))
    stored.execute("UPDATE spool SET time_s = 'soon'")
    stored.execute("UPDATE loss SET kind = 9 WHERE reason = 'x'")
    stored.execute("UPDATE loss SET first_s = 'soon'")

    _, recalled = stored.do(stored.table.recall)

    assert recalled.shares[Kind.EVENT].first_s == 0.0
    assert recalled.losses == (Loss("y", Kind.EVENT, 2, None, 1.0),)
