"""The outbox's table: rows of this run and of earlier ones."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing

import pytest

from gateway.errors import DamagedError
from gateway.store import OutboxPage, OutboxRow, OutboxTable, Rank, Total
from gateway.store.schema import STATE


@pytest.fixture
def disk() -> Iterator[sqlite3.Connection]:
    with closing(sqlite3.connect(":memory:")) as disk:
        for step in STATE.steps:
            step(disk)
        yield disk


def event(id_: int, text: str, key: str = "") -> OutboxRow:
    return OutboxRow(id_, Rank.EVENT, "b/event", text.encode(), 1.0 * id_, "run", key)


def test_what_is_staged_before_the_table_is_read_was_not_left_by_an_earlier_run(
    disk: sqlite3.Connection,
) -> None:
    OutboxTable().insert(disk, [event(1, "a", "old"), event(2, "b")])
    table = OutboxTable()

    table.insert(disk, [event(1, "c", "new"), event(1, "again")])

    assert table.totals(disk) == {Rank.EVENT: Total(2, sum(event(1, "a").size for _ in "ab"), 1.0, 2.0)}
    assert table.keys(disk) == ["old"]
    assert table.payloads(disk, ["old", "new", "none"]) == {"old": b"a", "new": b"c"}
    rows = [event(1, "a", "old")._replace(id=-1), event(2, "b")._replace(id=0)]
    assert table.page(disk, Rank.EVENT, -(2**40), 2) == OutboxPage(rows, 0, is_last=False)
    assert table.page(disk, Rank.EVENT, 0, 2) == OutboxPage([event(1, "c", "new")], 1, is_last=True)


@pytest.mark.parametrize("damage", ["topic = 'x'", "payload = 7", "time_s = 'x'", "checksum = 'x'"])
def test_a_message_that_is_not_what_was_stored_is_never_published(
    disk: sqlite3.Connection, damage: str
) -> None:
    table = OutboxTable()
    table.insert(disk, [event(1, "a", "key"), event(2, "b")])
    disk.execute(f"UPDATE outbox SET {damage} WHERE id = 1")

    with pytest.raises(DamagedError):
        table.page(disk, Rank.EVENT, 0, 2)
    with pytest.raises(DamagedError):
        table.payloads(disk, ["key"])
    assert table.page(disk, Rank.EVENT, 1, 2).is_last
