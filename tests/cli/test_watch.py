"""What `watch` shows of what gateways publish."""

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


class Published:
    """A gateway's messages, put into an overview."""

    def __init__(self, base: str = BASE, *, only: str = BASE) -> None:
        self.overview = Overview(base)
        self.only = only
        self.tokens = 0

    def put(self, topic: str, at_s: float = NOW_S, **fields: Any) -> None:
        self.overview.take(f"{self.only}/{topic}", json.dumps(fields).encode(), at_s)

    def token(self, at_s: float, *, ahead_s: float = 0.0) -> None:
        self.tokens += 1
        self.put("gateway/fresh", at_s, token=f"t{self.tokens}", time=rfc3339(at_s + ahead_s))

    def live(self, at_s: float = NOW_S, *, ahead_s: float = 0.0) -> None:
        self.put("gateway/status", state="online")
        self.token(at_s - 1.0, ahead_s=ahead_s)
        self.token(at_s, ahead_s=ahead_s)

    def state(self, starter: str, state: str, **fields: Any) -> None:
        fields = {"quality": "good", "time": rfc3339(NOW_S), "remote": True, **fields}
        self.put(f"starter/{starter}/availability", state="online")
        self.put(f"starter/{starter}/state", state=state, **fields)

    def text(self, now_s: float = NOW_S, *, height: int | None = None) -> str:
        console = Console(file=StringIO(), width=140)
        console.print(render(self.overview, now_s, height=height))
        assert isinstance(console.file, StringIO)
        return console.file.getvalue()

    def names(self) -> list[str]:
        return [row.name for row in self.overview.rows()]


def test_a_row_has_state_current_alarm_age_and_the_last_command() -> None:
    published = Published()
    published.live(NOW_S + 4.0)
    published.state("pump", "running")
    published.put("starter/pump/value/current", value=61.5, unit="A", quality="good")
    published.put("starter/pump/value/current_pct", value=72.0, unit="%", quality="good")
    published.put("starter/pump/alarm/a05", active=True, severity="alarm", text="Motor warm")
    published.put("result/pump/alice", verb="start", phase="confirmed", code="ok", time=rfc3339(NOW_S))

    row = next(line for line in published.text(NOW_S + 4.0).splitlines() if "pump" in line)

    for part in ("S", "running", "61.5 A", "72%", "A05 Motor warm", "4.0 s", "alice start: confirmed"):
        assert part in row


def test_without_a_new_token_for_twelve_seconds_a_gateway_is_not_live() -> None:
    published = Published()
    published.live()

    assert "NOT LIVE" not in published.text(NOW_S + 12.0)
    assert "NOT LIVE for 13 s" in published.text(NOW_S + 13.0)


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
def test_what_others_publish_there_changes_neither_table_nor_terminal(payload: bytes) -> None:
    published = Published()
    published.state("pump", "ready")
    for topic in (
        "gateway/status",
        "gateway/fresh",
        "starter/pump/value/current",
        "starter/pump/alarm/x",
        "x",
    ):
        published.overview.take(f"{BASE}/{topic}", payload, NOW_S)

    assert published.names() == ["pump"]
    assert "\x1b" not in published.text()


def test_what_somebody_must_look_at_comes_first_and_what_is_not_sure_has_a_question_mark() -> None:
    published = Published()
    for name, state in (("a", "ready"), ("b", "running"), ("c", "fault"), ("d", "ready"), ("e", "ready")):
        published.state(name, state)
    published.state("f", "running", quality="stale")
    published.put("starter/d/availability", state="offline", reason="silent")
    published.state("e", "ready", locked={"by": "alice", "reason": "bearing"})

    text = published.text()

    assert published.names() == ["c", "d", "e", "f", "b", "a"]
    assert "offline: silent" in text
    assert "locked by alice" in text
    assert "running?" in text
