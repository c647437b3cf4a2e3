"""The outbox's table: rows of this run and of earlier ones, and rows that are damaged."""

from __future__ import annotations

import sqlite3

from gateway.store import OutboxRow, OutboxTable, Rank
from gateway.store.outbox import TABLES

BEGINNING = -(2**40)


def disk() -> sqlite3.Connection:
    connection = sqlite3.connect(":memory:")
    for sql in TABLES:
        connection.execute(sql)
    return connection


def event(id_: int, text: str, key: str = "") -> OutboxRow:
    return OutboxRow(id_, Rank.EVENT, "b/event", text.encode(), 1.0, "run", key)


def test_what_is_staged_before_the_table_is_read_was_not_left_by_an_earlier_run() -> None:
    connection = disk()
    OutboxTable().insert(connection, [event(1, "a", "old")])
    table = OutboxTable()

    table.insert(connection, [event(1, "b", "new")])

    assert table.totals(connection)[Rank.EVENT].rows == 1
    assert table.keys(connection) == ["old"]


def test_a_damaged_row_is_reported_and_not_published() -> None:
    connection, table = disk(), OutboxTable()
    table.insert(connection, [event(1, "a"), event(2, "b")])

    connection.execute("UPDATE outbox SET payload = x'00' WHERE id = 1")
    page = table.page(connection, Rank.EVENT, BEGINNING, 100)

    assert [row.id for row in page.rows] == [2]
    assert [row.id for row in page.damaged] == [1]
    assert (page.upto, page.is_last) == (2, True)
