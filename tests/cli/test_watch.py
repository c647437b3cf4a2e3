"""The table of `watch`, drawn of records."""

from __future__ import annotations

from io import StringIO
from typing import Any

import pytest
from rich.console import Console

from gateway.cli.watch.overview import Overview
from gateway.cli.watch.table import render
from gateway.contract import (
    AlarmRecord,
    AvailabilityRecord,
    FreshRecord,
    LockRecord,
    Phase,
    Quality,
    Record,
    ResultRecord,
    StateRecord,
    StatusRecord,
    ValueRecord,
)

BASE = "starters/plant"
NOW_S = 1_700_000_000.0
LOCK = LockRecord(by="alice", since_s=NOW_S, reason="bearing")


def state(starter: str, word: Any, **fields: Any) -> StateRecord:
    known = {"quality": Quality.GOOD, "time_s": NOW_S - 20.0, "seq": 1, "flags": {"remote": True}}
    return StateRecord(starter=starter, state=word, **{**known, **fields})


def presence(starter: str, word: Any, reason: str | None = None) -> AvailabilityRecord:
    return AvailabilityRecord(starter=starter, state=word, since_s=NOW_S, reason=reason)


def value(starter: str, point: str, number: float, unit: str) -> ValueRecord:
    return ValueRecord(
        starter=starter, point=point, value=number, unit=unit, quality=Quality.GOOD, time_s=NOW_S, seq=2
    )


def alarm(
    starter: str, code: str, text: str, severity: Any = "alarm", *, is_active: bool = True
) -> AlarmRecord:
    times = {"time_s": NOW_S, "cleared_s": None if is_active else NOW_S}
    return AlarmRecord(
        starter=starter, code=code, text=text, severity=severity, is_active=is_active, count=1, seq=3, **times
    )


def result(starter: str, phase: Phase, code: str = "ok", **fields: Any) -> ResultRecord:
    known = {"id": "1", "verb": "start", "text": "", "time_s": NOW_S}
    return ResultRecord(starter=starter, client="alice", phase=phase, code=code, **{**known, **fields})


def overview(*records: Record, live_at_s: float | None = NOW_S, ahead_s: float = 0.0) -> Overview:
    """Return the overview of a gateway that has published these; its token changed last at `live_at_s`."""
    made = Overview(BASE)
    status = StatusRecord(state="online", time_s=NOW_S, boot="1", since_s=NOW_S, reason=None, run="1")
    tokens = [] if live_at_s is None else [(live_at_s - 1.0, "a"), (live_at_s, "b")]
    fresh = [(at_s, FreshRecord(token=token, time_s=at_s + ahead_s)) for at_s, token in tokens]
    for at_s, record in [*((NOW_S, record) for record in (status, *records)), *fresh]:
        made.take(f"{BASE}/{record.topic}", record.payload(), at_s)
    return made


def drawn(made: Overview, now_s: float = NOW_S, width: int = 80) -> str:
    console = Console(file=StringIO(), width=width)
    console.print(render(made, now_s))
    assert isinstance(console.file, StringIO)
    return console.file.getvalue()


PUMP = (
    state("pump", "running"),
    value("pump", "current", 61.5, "A"),
    value("pump", "current_pct", 72.0, "%"),
)


@pytest.mark.parametrize(
    ("records", "line"),
    [
        (PUMP, "pump running 61.5 A 72 % now"),
        ([*PUMP, result("pump", Phase.CONFIRMED)], "pump running 61.5 A 72 % now alice start: confirmed"),
        (
            [
                *PUMP,
                result("pump", Phase.REJECTED, "locked"),
                result("pump", Phase.CONFIRMED, is_duplicate=True),
            ],
            "pump running 61.5 A 72 % now alice start: rejected (locked)",
        ),
        ([*PUMP, alarm("pump", "a05", "Motor warm")], "S pump running 61.5 A 72 % now A05 Motor warm"),
        ([*PUMP, alarm("pump", "a05", "", is_active=False)], "pump running 61.5 A 72 % now"),
        (
            [state("pump", "fault"), alarm("pump", "e05", "Motor overload", "fault")],
            "F pump fault now E05 Motor overload",
        ),
        (
            [state("pump", "not_ready", flags={"remote": True, "power_present": False})],
            "pump not ready now no power",
        ),
        ([state("pump", "not_ready")], "pump not ready now pausing or being adjusted"),
        ([state("pump", "ready", flags={"remote": False})], "C pump ready now local"),
        ([state("pump", "ready", lock=LOCK)], "C pump ready now locked by alice: bearing"),
        ([state("pump", "running", quality=Quality.STALE)], "S pump running? 20 s"),
        (
            [state("pump", "unknown", quality=Quality.STALE), presence("pump", "offline", "no reply")],
            "F pump unknown? 20 s offline: no reply",
        ),
        ([presence("pump", "disabled")], "C pump unknown? never disabled"),
    ],
)
def test_a_starter_is_one_line_at_80_columns(records: Any, line: str) -> None:
    made = overview(*records)

    assert [" ".join(each.split()) for each in drawn(made).splitlines() if "pump" in each] == [line]


def test_a_long_reason_is_folded_and_not_cut() -> None:
    reason = "the starter answers as another family than the one that is configured"
    made = overview(state("pump", "unknown", reason=reason), result("pump", Phase.CONFIRMED))

    words = drawn(made).split()

    assert {*reason.split()[:-1], "configured;", "confirmed"} <= set(words)


def test_a_gateway_without_a_new_token_for_three_seconds_is_not_live_and_ages_count_by_its_clock() -> None:
    made = overview(*PUMP, ahead_s=100.0)

    assert "online  LIVE  1 starter\n" in drawn(made, NOW_S + 3.0)
    stopped = drawn(made, NOW_S + 4.0)
    assert "NOT LIVE for 4.0 s" in stopped
    assert "1 min 44 s" in stopped
    assert "NOT LIVE since this table began" in drawn(overview(*PUMP, live_at_s=None))


def test_starters_that_somebody_must_look_at_come_first_then_those_that_move() -> None:
    made = overview(
        *(
            state(name, word)
            for name, word in (("a", "ready"), ("b", "running"), ("c", "fault"), ("d", "ready"))
        ),
        state("e", "ready", lock=LOCK),
        state("f", "running", quality=Quality.STALE),
        presence("d", "offline", "silent"),
    )

    assert [row.name for row in made.rows()] == ["c", "d", "e", "f", "b", "a"]
    assert "LIVE  6 starters, 2 with a fault or offline" in drawn(made)


def test_a_starter_that_its_gateway_has_no_longer_is_gone() -> None:
    made = overview(*PUMP)

    made.take(f"{BASE}/starter/pump/state", b"", NOW_S)

    assert made.rows() == []


@pytest.mark.parametrize(
    "payload",
    [
        b"\xff",
        b"[]",
        b"{",
        b'{"state":7,"time":9,"locked":[]}',
        b'{"time":"soon"}',
        b'{"state":"\\u001b[2J"}',
    ],
)
def test_foreign_messages_change_neither_table_nor_terminal(payload: bytes) -> None:
    made = overview(state("pump", "ready", reason="\x1b[2J"))
    for topic in ("gateway/status", "gateway/fresh", "starter/pump/value/current", "starter/fan/state", "x"):
        made.take(f"{BASE}/{topic}", payload, NOW_S)

    assert [row.name for row in made.rows()] == ["pump"]
    assert "\x1b" not in drawn(made)


def test_one_table_has_the_gateways_of_a_plant() -> None:
    made = Overview("starters/+")
    for name in ("north", "south"):
        record = state("pump", "ready")
        made.take(f"starters/{name}/{record.topic}", record.payload(), NOW_S)

    lines = drawn(made).splitlines()
    assert [sum(f"starters/{name} pump" in line for line in lines) for name in ("north", "south")] == [1, 1]
