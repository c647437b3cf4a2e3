"""The audit: one hash chain that shows every change, bounded, over everything that is given up or lost."""

from __future__ import annotations

import asyncio
import json
import sqlite3
from contextlib import closing
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.store import Connection, Head, Store, verify
from gateway.store.audit import _ANCHOR, Audit, _place, append
from gateway.store.chain import canonical, link, read_line
from gateway.store.schema import STATE
from tests.store.store_rig import PATIENCE_S


def chain(count: int, head: Head = Head()) -> list[str]:  # noqa: B008 - frozen
    lines = []
    for number in range(count):
        line, head = link(head, {"what": f"entry {number}"})
        lines.append(line)
    return lines


def placed(lines: list[str]) -> list[tuple[str, str]]:
    return [(f"line {number}", line) for number, line in enumerate(lines, 1)]


@pytest.mark.parametrize(
    ("value", "text"),
    [
        ({"b": 1, "a": 2.0}, '{"a":2.0,"b":1}'),
        ({"t": (1, [True, None])}, '{"t":[1,[true,null]]}'),
        ("°C", '"°C"'),
        ("\ud800", '"?"'),
        (b"\x01", "\"b'\\\\x01'\""),
        ({1: "one"}, '{"1":"one"}'),
    ],
)
def test_a_value_has_one_canonical_text(value: Any, text: str) -> None:
    assert canonical(value) == text


def test_the_hash_is_sha_256_over_the_previous_hash_and_the_canonical_json() -> None:
    line, _ = link(Head(), {"what": "first"})

    # printf '%064d{"n":1,"what":"first"}' 0 | sha256sum
    assert json.loads(line)["hash"] == "1cce82bf4c562891f3db91553f352606fef3dfda2c58a057fd34fc731a0f0b44"


@given(st.integers(0, 4), st.data())
def test_no_changed_octet_goes_unnoticed(place: int, data: st.DataObject) -> None:
    lines = chain(5)
    position = data.draw(st.integers(0, len(lines[place]) - 1))
    other = data.draw(st.characters(exclude_characters=lines[place][position], codec="utf-8"))
    lines[place] = lines[place][:position] + other + lines[place][position + 1 :]

    assert verify(placed(lines), after=Head()).problems


def test_a_line_that_was_changed_with_its_own_hash_recomputed_breaks_the_next() -> None:
    lines = chain(5)
    _, before = read_line(lines[1])
    lines[2] = link(before, {"what": "forged"})[0]

    problems = verify(placed(lines), after=Head()).problems

    assert problems == ["line 4: does not follow line 3: something was removed, inserted or exchanged"]


def lines(connection: Connection) -> list[tuple[str, str]]:
    return [
        (str(n), line)
        for n, line in connection.execute("SELECT number, line FROM audit WHERE number > 0 ORDER BY number")
    ]


def test_the_oldest_lines_go_and_what_is_left_is_one_chain(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gateway.store.audit.MOST_BYTES", 20_000)
    with closing(sqlite3.connect(":memory:")) as connection:
        for step in STATE.steps:
            step(connection)
        for number in range(1, 351):
            append(connection, entry={"kind": "note", "text": f"{number} {'x' * 80}"})
            (anchor, _), left = _place(connection, _ANCHOR), lines(connection)

            assert verify(left, after=anchor).problems == []
            assert sum(len(line) for _, line in left) <= 20_000
            assert anchor.number + len(left) == number

        connection.execute(
            "DELETE FROM audit WHERE number = (SELECT min(number) FROM audit WHERE number > 0)"
        )
        assert verify(lines(connection), after=anchor).problems != []


async def test_entries_that_are_too_many_are_counted_once_something_can_be_stored() -> None:
    store = Store(None, STATE, most_waiting=3)
    audit = Audit(store, boot="b")
    for number in range(7):
        audit.note("x", f"{number}")
    store.start(lambda *_: None)
    while store.unsaved:  # noqa: ASYNC110 - its thread changes that
        await asyncio.sleep(0)
    await asyncio.sleep(0)
    found = [line for _, line in await asyncio.wrap_future(store.submit(lines))]
    store.close(within_s=PATIENCE_S)

    texts = ("4", "5", "6", "4 entries could not be stored")
    assert [f'"text":"{text}' in line for text, line in zip(texts, found, strict=True)] == [True] * 4


@pytest.mark.parametrize("is_opened", [True, False])
async def test_before_an_orderly_end_all_that_waits_is_written_once_or_counted(*, is_opened: bool) -> None:
    store, found = Store(None, STATE), list[tuple[str, str]]()
    audit = Audit(store, boot="b")
    for number in range(1200):
        audit.note("x", f"{number}")
    if is_opened:
        store.start(lambda *_: None)
        store.submit(lambda connection: found.extend(lines(connection)))
    store.close(within_s=PATIENCE_S)

    assert (len(found), store.unsaved) == ((1200, 0) if is_opened else (0, 1200))
