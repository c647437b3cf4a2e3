from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from gateway.database import Connection, Database
from gateway.durable.ledger_table import LONGEST_S, PRUNED_EVERY, LedgerRow, LedgerTable
from gateway.errors import DamagedError

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


class Kept:
    """A table in a database of its own, used without a thread."""

    def __init__(self, folder: Path, table: LedgerTable) -> None:
        self.table = table
        self.database = Database(folder / "x.sqlite", [table], 2**20)
        self.database.open()

    def put(self, *rows: LedgerRow, now_s: float = 10.0) -> None:
        for row in rows:

            def work(connection: Connection, row: LedgerRow = row) -> None:
                self.table.put(connection, row=row, now_s=now_s)

            self.database.transact([work])

    def rows(self) -> list[LedgerRow]:
        (rows,) = self.database.transact([self.table.rows])
        return list(rows)

    def ids(self) -> list[str]:
        return [row.id for row in self.rows()]


@pytest.fixture
def kept(tmp_path: Path) -> Iterator[Kept]:
    kept = Kept(tmp_path, LedgerTable(most_rows=100, least_rows=0))
    yield kept
    kept.database.close()


def final(id_: str, since_s: float = 10.0) -> LedgerRow:
    return replace(ROW, id=id_, phase="confirmed", is_final=1, since_s=since_s)


def test_a_row_is_returned_as_it_was_put(kept: Kept) -> None:
    kept.put(ROW)

    assert kept.rows() == [ROW]


def test_a_later_phase_replaces_the_earlier_one_but_not_the_commands_age(kept: Kept) -> None:
    kept.put(ROW)

    kept.put(replace(final("1"), since_s=99.0))

    assert kept.rows() == [final("1")]


def test_what_may_have_been_written_stays_so(kept: Kept) -> None:
    kept.put(replace(ROW, may_be_written=1))

    kept.put(replace(ROW, phase="written"))

    assert kept.rows()[0].may_be_written == 1


def test_rows_come_in_the_order_of_their_commands(kept: Kept) -> None:
    kept.put(final("b"), final("a"), final("c"))

    kept.put(final("b"))

    assert kept.ids() == ["b", "a", "c"]


def test_the_oldest_finished_rows_go_when_there_are_too_many(kept: Kept) -> None:
    kept.put(replace(ROW, id="under way"))

    kept.put(*(final(str(number)) for number in range(300)))

    ids = kept.ids()
    assert "under way" in ids
    assert ids[-1] == "299"
    assert "0" not in ids
    assert len(ids) <= 100 + PRUNED_EVERY


def test_finished_rows_go_after_seven_days(kept: Kept) -> None:
    kept.put(final("old"), final("young", since_s=20.0), replace(ROW, id="under way"))

    kept.put(*(final("new", since_s=LONGEST_S + 15.0) for _ in range(PRUNED_EVERY + 1)), now_s=LONGEST_S + 15)

    assert kept.ids() == ["young", "under way", "new"]


def test_a_clock_that_is_set_at_last_makes_nobody_forget_the_latest_commands(tmp_path: Path) -> None:
    kept = Kept(tmp_path, LedgerTable(least_rows=PRUNED_EVERY))
    in_1970 = [final(f"{number}", since_s=10.0 + number) for number in range(PRUNED_EVERY)]
    kept.put(*in_1970)

    kept.put(final("in 2026", since_s=1.8e9), now_s=1.8e9)
    kept.put(*[final("in 2026", since_s=1.8e9)] * (PRUNED_EVERY + 1), now_s=1.8e9)

    assert kept.ids() == [*(str(number) for number in range(1, PRUNED_EVERY)), "in 2026"]
    kept.database.close()


def test_room_is_made_from_the_oldest_finished_rows(kept: Kept) -> None:
    kept.put(replace(ROW, id="under way"), *(final(str(number)) for number in range(20)))

    kept.database.make_room()

    assert kept.ids() == ["under way", *(str(number) for number in range(3, 20))]


@pytest.mark.parametrize("column", ["time_s", "since_s"])
def test_a_row_that_has_lost_its_shape_is_damage(kept: Kept, column: str) -> None:
    kept.put(ROW)

    kept.database.transact([lambda connection: connection.execute(f"UPDATE ledger SET {column} = 'x'")])

    with pytest.raises(DamagedError):
        kept.rows()
