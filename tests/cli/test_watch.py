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
    InfoRecord,
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
STARTER = {
    "starter": "pump",
    "family": "ssw07",
    "quality": Quality.GOOD,
    "flags": {"remote": True},
    "since_s": NOW_S,
}
ALARM = {"is_active": True, "severity": "alarm", "points": {}}
COMMAND = {"client": "alice", "verb": "start", "code": "ok", "values": {}, "commands": ()}
KNOWN = {
    **dict.fromkeys(("model", "firmware", "serial", "cleared_s")),
    **dict.fromkeys(("reason", "text"), ""),
    **dict.fromkeys(("seq", "count", "address"), 1),
    **dict.fromkeys(("id", "run", "boot", "line"), "1"),
    **STARTER,
    **ALARM,
    **COMMAND,
}


def made(kind: type[Record], time_s: float = NOW_S, **fields: Any) -> Record:
    known = {**KNOWN, "time_s": time_s, **fields}
    return kind(**{name: known[name] for name in kind.__dataclass_fields__ if name in known})


def state(word: str, **fields: Any) -> Record:
    return made(StateRecord, NOW_S - 20.0, state=word, **fields)


def presence(word: str, **fields: Any) -> Record:
    return made(AvailabilityRecord, state=word, **fields)


def alarm(code: str, text: str, **fields: Any) -> Record:
    return made(AlarmRecord, code=code, text=text, **fields)


def result(phase: Phase, **fields: Any) -> Record:
    return made(ResultRecord, phase=phase, **fields)


def overview(*records: Record, live_at_s: float | None = NOW_S, ahead_s: float = 0.0) -> Overview:
    """Return the overview of a gateway that has published these; its token changed last at `live_at_s`."""
    found = Overview(BASE)
    status = made(StatusRecord, state="online")
    tokens = [] if live_at_s is None else [(live_at_s - 1.0, "a"), (live_at_s, "b")]
    fresh = [(at_s, FreshRecord(token=token, time_s=at_s + ahead_s)) for at_s, token in tokens]
    for at_s, record in [*((NOW_S, record) for record in (status, *records)), *fresh]:
        found.take(f"{BASE}/{record.topic}", record.payload(), at_s)
    return found


def drawn(found: Overview, now_s: float = NOW_S, width: int = 80) -> str:
    console = Console(file=StringIO(), width=width)
    console.print(render(found, now_s, width))
    assert isinstance(console.file, StringIO)
    return console.file.getvalue()


CURRENT = made(ValueRecord, point="current", value=61.5, unit="A")
TITLED = made(InfoRecord, title="Raw pump")
PUMP = (state("running"), CURRENT, made(ValueRecord, point="current_pct", value=72.0, unit="%"))


@pytest.mark.parametrize(
    ("records", "line"),
    [
        (PUMP, "pump running 61.5 A 72 % now"),
        ([*PUMP, TITLED], "Raw pump running 61.5 A 72 % now"),
        ([*PUMP, result(Phase.CONFIRMED)], "pump running 61.5 A 72 % now alice start: confirmed"),
        (
            [
                *PUMP,
                result(Phase.REJECTED, code="locked"),
                result(Phase.CONFIRMED, is_duplicate=True),
            ],
            "pump running 61.5 A 72 % now alice start: rejected (locked)",
        ),
        ([*PUMP, alarm("a05", "Motor warm")], "S pump running 61.5 A 72 % now A05 Motor warm"),
        ([*PUMP, alarm("a05", "", is_active=False)], "pump running 61.5 A 72 % now"),
        (
            [state("fault"), alarm("e05", "Motor overload", severity="fault")],
            "F pump fault now E05 Motor overload",
        ),
        (
            [state("not_ready", flags={"remote": True, "power_present": False})],
            "pump not ready now no power",
        ),
        ([state("not_ready")], "pump not ready now pausing or being adjusted"),
        ([state("ready", flags={"remote": False})], "C pump ready now local"),
        ([state("ready", lock=LOCK)], "C pump ready now locked by alice: bearing"),
        ([state("running", quality=Quality.STALE)], "S pump running? 20 s"),
        (
            [state("unknown", quality=Quality.STALE), presence("offline", reason="no reply")],
            "F pump unknown? 20 s offline: no reply",
        ),
        ([presence("disabled")], "C pump unknown? never disabled"),
    ],
)
def test_a_starter_is_one_line_at_80_columns(records: Any, line: str) -> None:
    found = overview(*records)

    assert [" ".join(each.split()) for each in drawn(found).splitlines() if "pump" in each] == [line]


def test_a_long_reason_stands_on_lines_of_its_own_and_is_not_cut() -> None:
    reason = "the starter answers as another family than the one that is configured"
    found = overview(state("not_ready", reason=reason), result(Phase.CONFIRMED))

    lines = drawn(found).splitlines()

    assert max(map(len, lines)) <= 80
    at = next(number for number, line in enumerate(lines) if "pump" in line)
    assert lines[at].split() == ["pump", "not", "ready", "now"]
    said = " ".join(" ".join(lines[at + 1 :]).split())
    assert said == f"{reason}; pausing or being adjusted; alice start: confirmed"


def test_a_gateway_without_a_new_token_for_three_seconds_is_not_live_and_ages_count_by_its_clock() -> None:
    found = overview(*PUMP, ahead_s=100.0)

    assert "online  LIVE  1 starter\n" in drawn(found, NOW_S + 3.0)
    stopped = drawn(found, NOW_S + 4.0)
    assert "NOT LIVE for 4.0 s" in stopped
    assert "1 min 44 s" in stopped
    assert "NOT LIVE since this table began" in drawn(overview(*PUMP, live_at_s=None))


def test_starters_that_somebody_must_look_at_come_first_then_those_that_move() -> None:
    found = overview(
        *(
            state(word, starter=name)
            for name, word in (("a", "ready"), ("b", "running"), ("c", "fault"), ("d", "ready"))
        ),
        state("ready", starter="e", lock=LOCK),
        state("running", starter="f", quality=Quality.STALE),
        presence("offline", starter="d", reason="silent"),
    )

    assert [row.name for row in found.rows()] == ["c", "d", "e", "f", "b", "a"]
    assert "LIVE  6 starters, 2 with a fault or offline" in drawn(found)


def test_an_alarm_and_a_starter_that_the_gateway_has_had_forgotten_are_gone() -> None:
    found = overview(*PUMP, alarm("e05", "Motor overload", severity="fault"))
    assert "E05" in drawn(found)

    found.take(f"{BASE}/starter/pump/alarm/e05", b"", NOW_S)
    assert "E05" not in drawn(found)

    found.take(f"{BASE}/starter/pump/state", b"", NOW_S)
    assert found.rows() == []


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
    found = overview(state("ready", reason="\x1b[2J"))
    for topic in ("gateway/status", "gateway/fresh", "starter/pump/value/current", "starter/fan/state", "x"):
        found.take(f"{BASE}/{topic}", payload, NOW_S)

    assert [row.name for row in found.rows()] == ["pump"]
    assert "\x1b" not in drawn(found)


def test_a_long_title_is_cut_so_that_each_starter_keeps_one_line() -> None:
    long = made(InfoRecord, title="Raw water pump of the northern works, beside the old boiler")
    load = made(ValueRecord, point="current_pct", value=72.0, unit="%", starter="fan")
    found = overview(*PUMP, long, state("not_ready", starter="fan"), load)

    lines = drawn(found).splitlines()
    assert [line for line in lines if "Raw water pump" in line and "61.5 A 72 %" in line and "\u2026" in line]
    assert len(lines) == 5  # the fan has a text of its own below it


def test_one_table_has_the_gateways_of_a_plant_but_those_that_are_not_there() -> None:
    found = Overview("starters/+")
    ready, offline = state("ready"), made(StatusRecord, state="offline")
    for name, record, payload in (
        ("none", offline, b""),
        ("foreign", offline, b"{"),
        ("gone", offline, offline.payload()),
        ("gone", offline, b""),
    ):
        found.take(f"starters/{name}/{record.topic}", payload, NOW_S)
    assert "no gateway has published" in drawn(found)

    for name in ("north", "south"):
        found.take(f"starters/{name}/{ready.topic}", ready.payload(), NOW_S)
    found.take(f"starters/west/{offline.topic}", offline.payload(), NOW_S)

    text = drawn(found)
    assert [text.count(f"starters/{name} pump") for name in ("north", "south")] == [1, 1]
    assert "starters/west" in text
    assert not [name for name in ("none", "foreign", "gone") if name in text]
