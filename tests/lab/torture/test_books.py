"""The judges of the torture can find fault."""

from __future__ import annotations

from typing import Any

import pytest

from tests.lab.torture.books import Books, unfinished
from tests.lab.torture.machine import DelayMeter


def event(seq: int, *, boot: str = "a", code: str = "fault") -> dict[str, Any]:
    return {"boot": boot, "seq": seq, "code": code, "topic": "starter/mill/event", "data": {}}


def history(*seqs: int) -> dict[str, Any]:
    return {"boot": "a", "items": [value(seq) for seq in seqs]}


def value(seq: int) -> dict[str, Any]:
    return {"point": "current", "seq": seq, "time": f"{seq}"}


def test_an_event_that_comes_again_is_counted_once() -> None:
    books = Books()

    for each in (event(1), event(3), event(1), event(2, boot="b")):
        books.event(each)

    assert (books.count("fault", starter="mill"), books.repeated, books.wrong) == (3, 1, [])


@pytest.mark.parametrize(
    "second", [event(1), event(2, code="started")], ids=["out of order", "another event of one name"]
)
def test_an_event_that_misleads_is_wrong(second: dict[str, Any]) -> None:
    books = Books()

    books.event(event(2))
    books.event(second)

    assert len(books.wrong) == 1


def test_a_history_may_come_again_but_not_out_of_order() -> None:
    books = Books()

    books.history("starter/mill/history", history(1, 2, 5))
    books.history("starter/mill/history", history(2, 5, 6))
    is_right = not books.wrong
    books.history("starter/mill/history", history(4))

    assert is_right
    assert books.published_late == 5
    assert len(books.wrong) == 1


def test_a_value_that_was_published_live_may_come_again_in_a_history() -> None:
    books = Books()

    books.value("mill", "current", value(1))
    books.history("starter/mill/history", history(2))
    books.history("starter/mill/history", history(1))

    assert (books.published_late, books.repeated, books.wrong) == (1, 1, [])


def test_a_command_that_was_accepted_and_never_ended_is_unfinished() -> None:
    results = [
        {"id": id_, "phase": phase}
        for id_, phase in (("1", "accepted"), ("2", "accepted"), ("2", "confirmed"), ("3", "rejected"))
    ]

    assert unfinished(results) == ["1"]


def test_a_machine_that_is_not_watched_has_held_nothing_up() -> None:
    machine = DelayMeter()

    assert machine.held_s(0.0) == 0.0
