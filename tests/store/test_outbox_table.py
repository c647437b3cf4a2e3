"""The outbox's table: rows of this run and of earlier ones, and rows that are damaged."""

from __future__ import annotations

import sqlite3

import pytest

from gateway.store import Loss, OutboxPage, OutboxRow, OutboxTable, Rank
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


@pytest.mark.parametrize(
    "damage",
    ["payload = x'00'", "payload = 7", "time_s = 'x'", "time_s = 1e300", "key = 1", "checksum = 'x'"],
)
def test_of_a_damaged_row_the_id_alone_is_reported(damage: str) -> None:
    connection, table = disk(), OutboxTable()
    table.insert(connection, [event(1, "a"), event(2, "b")])

    connection.execute(f"UPDATE outbox SET {damage} WHERE id = 1")
    page = table.page(connection, Rank.EVENT, BEGINNING, 100)

    assert page == OutboxPage([event(2, "b")], [1], upto=2, is_last=True)


@pytest.mark.parametrize("column", ["payload", "time_s", "key"])
@pytest.mark.parametrize("value", ["7", "'x'", "x'00'", "1e300", "-1e300"])
def test_what_is_counted_of_earlier_runs_bears_any_damage(column: str, value: str) -> None:
    connection = disk()
    OutboxTable().insert(connection, [event(1, "a", "old"), event(2, "b", "old")])

    connection.execute(f"UPDATE outbox SET {column} = {value} WHERE id = 1")
    total = OutboxTable().totals(connection)[Rank.EVENT]

    assert (total.rows, total.last_s) == (2, 7.0 if (column, value) == ("time_s", "7") else 1.0)
    assert all(isinstance(key, str) for key in OutboxTable().keys(connection))


@pytest.mark.parametrize(
    "damage", ["rank = 9", "rank = 'x'", "rows = 'x'", "first_s = 'x'", "last_s = 1e300"]
)
def test_a_damaged_loss_is_left_out(damage: str) -> None:
    connection, table = disk(), OutboxTable()
    losses = [Loss("disk_full", rank, 3, 1.0, 2.0) for rank in (Rank.VALUE, Rank.EVENT)]
    table.set_losses(connection, losses)

    connection.execute(f"UPDATE outbox_losses SET {damage} WHERE rank = 0")

    assert table.losses(connection) == losses[1:]
