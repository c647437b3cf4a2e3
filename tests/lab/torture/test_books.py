"""The judges of the torture can find fault."""

from __future__ import annotations

from typing import Any

import pytest

from tests.lab.torture.books import Books, unfinished

TOPIC = "starter/mill/history"


def event(seq: int, *, boot: str = "a", code: str = "fault") -> dict[str, Any]:
    return {"boot": boot, "seq": seq, "code": code, "topic": "starter/mill/event", "data": {}}


def value(seq: int) -> dict[str, Any]:
    return {"point": "current", "seq": seq, "time": f"{seq}"}


def history(*seqs: int) -> dict[str, Any]:
    return {"boot": "a", "items": [value(seq) for seq in seqs]}


@pytest.mark.parametrize(
    ("events", "different", "repeated", "wrong"),
    [
        ((event(1), event(3), event(1), event(2, boot="b")), 3, 1, 0),
        ((event(2), event(1)), 2, 0, 1),  # out of order
        ((event(2), event(2, code="started")), 1, 1, 1),  # another event of one name
    ],
)
def test_an_event_that_comes_again_is_counted_once_and_one_that_misleads_is_wrong(
    events: tuple[dict[str, Any], ...], different: int, repeated: int, wrong: int
) -> None:
    books = Books()

    for each in events:
        books.event(each)

    assert (books.faults_of("mill"), books.repeated, len(books.wrong)) == (different, repeated, wrong)


@pytest.mark.parametrize(
    ("live", "histories", "late", "wrong"),
    [
        ((), ((1, 2, 5), (2, 5, 6)), 4, 0),
        ((), ((1, 2, 5), (4,)), 4, 1),  # out of order
        ((1,), ((2,), (1,)), 1, 0),  # a value that was published live
    ],
)
def test_a_history_may_come_again_but_not_out_of_order(
    live: tuple[int, ...], histories: tuple[tuple[int, ...], ...], late: int, wrong: int
) -> None:
    books = Books()

    for seq in live:
        books.value("mill", "current", value(seq))
    for seqs in histories:
        books.history(TOPIC, history(*seqs))

    assert (books.published_late, len(books.wrong)) == (late, wrong)


def test_a_command_that_was_accepted_and_never_ended_is_unfinished() -> None:
    phases = (("1", "accepted"), ("2", "accepted"), ("2", "confirmed"), ("3", "rejected"))

    assert unfinished([{"id": id_, "phase": phase} for id_, phase in phases]) == ["1"]
