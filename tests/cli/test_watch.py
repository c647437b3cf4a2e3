"""The table of `watch`, drawn of messages."""

from __future__ import annotations

import json
from io import StringIO
from typing import Any

import pytest
from rich.console import Console

from gateway.cli.watch.overview import Overview
from gateway.cli.watch.table import render
from gateway.contract import rfc3339

BASE = "starters/plant"
NOW_S = 1_700_000_000.0
NOW = rfc3339(NOW_S)
LOCK = {"by": "alice", "since": NOW, "reason": "bearing"}
FIELDS = {  # of each kind of message, by the level that names it
    "status": {"state": "online", "time": NOW, "boot": "1", "run": "1", "since": NOW, "reason": None},
    "info": dict.fromkeys(("model", "firmware", "serial"))
    | {"family": "ssw07", "line": "l", "address": 1, "points": {}, "commands": []},
    "availability": {"since": NOW, "reason": None},
    "state": {"quality": "good", "time": rfc3339(NOW_S - 20.0), "seq": 1, "remote": True},
    "alarm": {"active": True, "severity": "alarm", "text": "", "time": NOW, "cleared": None}
    | {"count": 1, "seq": 1},
    "value": {"quality": "good", "time": NOW, "seq": 1},
    "result": {"id": "1", "verb": "start", "code": "ok", "text": "", "time": NOW},
}
Said = tuple[str, dict[str, Any]]


def said(topic: str, **fields: Any) -> Said:
    """Return a message of the gateway, of a starter, or a result, without the first level of its topic."""
    kind = next(level for level in FIELDS if level in topic.split("/"))
    root = {"status": "gateway", "result": ""}.get(kind, "starter")
    return f"{root}/{topic}".lstrip("/"), {**FIELDS[kind], **fields}


def take(found: Overview, message: Said, at_s: float = NOW_S, base: str = BASE) -> None:
    found.take(f"{base}/{message[0]}", json.dumps(message[1]).encode(), at_s)


def overview(*messages: Said, live_at_s: float | None = NOW_S, ahead_s: float = 0.0) -> Overview:
    """Return the overview of a gateway that has published these; its token changed last at `live_at_s`."""
    found = Overview(BASE)
    for message in (said("status"), *messages):
        take(found, message)
    for at_s, token in [] if live_at_s is None else [(live_at_s - 1.0, "a"), (live_at_s, "b")]:
        take(found, ("gateway/fresh", {"token": token, "time": rfc3339(at_s + ahead_s)}), at_s)
    return found


def drawn(found: Overview, now_s: float = NOW_S, width: int = 80) -> str:
    console = Console(file=StringIO(), width=width)
    console.print(render(found, now_s, width))
    assert isinstance(console.file, StringIO)
    return console.file.getvalue()


TITLED = said("pump/info", title="Raw pump")
LOAD = {"value": 72.0, "unit": "%"}
RUNNING = said("pump/state", state="running")
PUMP = (RUNNING, said("pump/value/current", value=61.5, unit="A"), said("pump/value/current_pct", **LOAD))
CONFIRMED = said("result/pump/alice", phase="confirmed")
REJECTED = said("result/pump/alice", phase="rejected", code="locked")
OVERLOAD = said("pump/alarm/e05", text="Motor overload", severity="fault")


@pytest.mark.parametrize(
    ("messages", "line"),
    [
        (PUMP, "pump running 61.5 A 72 % now"),
        ([*PUMP, TITLED], "Raw pump running 61.5 A 72 % now"),
        ([*PUMP, CONFIRMED], "pump running 61.5 A 72 % now alice start: confirmed"),
        (
            [*PUMP, REJECTED, said("result/pump/alice", phase="confirmed", duplicate=True)],
            "pump running 61.5 A 72 % now alice start: rejected (locked)",
        ),
        ([*PUMP, said("pump/alarm/a05", text="Motor warm")], "S pump running 61.5 A 72 % now A05 Motor warm"),
        ([*PUMP, said("pump/alarm/a05", active=False)], "pump running 61.5 A 72 % now"),
        ([said("pump/state", state="fault"), OVERLOAD], "F pump fault now E05 Motor overload"),
        ([said("pump/state", state="not_ready", power_present=False)], "pump not ready now no power"),
        ([said("pump/state", state="not_ready")], "pump not ready now pausing or being adjusted"),
        ([said("pump/state", state="ready", remote=False)], "C pump ready now local"),
        ([said("pump/state", state="ready", locked=LOCK)], "C pump ready now locked by alice: bearing"),
        ([said("pump/state", state="running", quality="stale")], "S pump running? 20 s"),
        (
            [
                said("pump/state", state="unknown", quality="stale"),
                said("pump/availability", state="offline", reason="no reply"),
            ],
            "F pump unknown? 20 s offline: no reply",
        ),
        ([said("pump/availability", state="disabled")], "C pump unknown? never disabled"),
    ],
)
def test_a_starter_is_one_line_at_80_columns(messages: Any, line: str) -> None:
    found = overview(*messages)

    assert [" ".join(each.split()) for each in drawn(found).splitlines() if "pump" in each] == [line]


def test_a_long_reason_stands_on_lines_of_its_own_and_a_long_title_is_cut() -> None:
    reason = "the starter answers as another family than the one that is configured"
    title = "Raw water pump of the northern works, beside the old boiler"
    fan = said("fan/state", state="not_ready", reason=reason)
    found = overview(*PUMP, said("pump/info", title=title), fan, said("result/fan/alice", phase="confirmed"))

    lines = drawn(found).splitlines()

    assert max(map(len, lines)) <= 80
    at = next(number for number, line in enumerate(lines) if "fan" in line)
    assert [text in lines[at - 1] for text in ("Raw water pump", "\u2026", "61.5 A 72 %")] == [True] * 3
    assert lines[at].split() == ["fan", "not", "ready", "now"]
    text = " ".join(" ".join(lines[at + 1 :]).split())
    assert text == f"{reason}; pausing or being adjusted; alice start: confirmed"


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
            said(f"{name}/state", state=word)
            for name, word in (("a", "ready"), ("b", "running"), ("c", "fault"), ("d", "ready"))
        ),
        said("e/state", state="ready", locked=LOCK),
        said("f/state", state="running", quality="stale"),
        said("d/availability", state="offline", reason="silent"),
    )

    assert [row.name for row in found.rows()] == ["c", "d", "e", "f", "b", "a"]
    assert "LIVE  6 starters, 2 with a fault or offline" in drawn(found)


def test_an_alarm_and_a_starter_that_the_gateway_has_had_forgotten_are_gone() -> None:
    found = overview(*PUMP, said("pump/availability", state="online"), OVERLOAD, CONFIRMED)
    assert "E05" in drawn(found)

    found.take(f"{BASE}/starter/pump/alarm/e05", b"", NOW_S)
    assert "E05" not in drawn(found)

    found.take(f"{BASE}/starter/pump/availability", b"", NOW_S)
    assert found.rows() == []

    take(found, RUNNING)  # another one has its name now
    assert "alice" not in drawn(found)


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
    found = overview(said("pump/state", state="ready", reason="\x1b[2J"))
    for topic in ("gateway/status", "gateway/fresh", "starter/pump/value/current", "starter/fan/state", "x"):
        found.take(f"{BASE}/{topic}", payload, NOW_S)

    assert [row.name for row in found.rows()] == ["pump"]
    assert "\x1b" not in drawn(found)


def test_one_table_has_the_gateways_of_a_plant_but_those_that_are_not_there() -> None:
    found, offline = Overview("starters/+"), said("status", state="offline")
    found.take("starters/none/gateway/status", b"", NOW_S)
    found.take("starters/foreign/gateway/status", b"{", NOW_S)
    take(found, offline, base="starters/gone")
    found.take("starters/gone/gateway/status", b"", NOW_S)
    assert "no gateway has published" in drawn(found)

    for name, message in (("north", RUNNING), ("south", RUNNING), ("west", offline)):
        take(found, message, base=f"starters/{name}")

    text = drawn(found)
    assert [text.count(f"starters/{name} pump") for name in ("north", "south")] == [1, 1]
    assert "starters/west" in text
    assert not [name for name in ("none", "foreign", "gone") if name in text]
