from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from gateway.records import AuditRecord
from gateway.storage.audit import log as audit_log
from gateway.storage.audit.chain import read_line
from gateway.storage.audit.log import AuditLog
from gateway.storage.audit.segments import lines

PATIENCE_S = 10.0


def record(seq: int, **more: Any) -> AuditRecord:
    fields = {
        "starter": "pump-1",
        "client": "alice",
        "operator": "Alice A.",
        "verb": "set",
        "args": {"parameter": "P102", "value": 5.0},
        "decision": "confirmed",
        "code": "ok",
        "time_s": 1_760_000_000.0,
        "seq": seq,
        "before": {"current": float("nan")},
        "after": {"current": 12.5},
        "id": "7f",
        "reason": "as agreed",
    }
    return AuditRecord(**{**fields, **more})


def entries(folder: Path) -> list[dict[str, Any]]:
    return [read_line(line)[0] for _, line in lines(folder)]


class Trouble:
    """What the log has reported, and a way to wait for it."""

    def __init__(self) -> None:
        self.reported: list[str] = []
        self._changed = threading.Condition()

    def receive(self, trouble: str) -> None:
        with self._changed:
            self.reported.append(trouble)
            self._changed.notify_all()

    def until(self, count: int) -> None:
        with self._changed:
            assert self._changed.wait_for(lambda: len(self.reported) >= count, PATIENCE_S)


@pytest.fixture
def trouble() -> Trouble:
    return Trouble()


@pytest.fixture
def log(tmp_path: Path, trouble: Trouble) -> Iterator[AuditLog]:
    log = AuditLog(tmp_path / "audit", boot="boot-1", retry_s=0.02)
    yield log
    log.close(within_s=PATIENCE_S)


def test_a_disk_that_is_away_is_reported_once_and_what_waited_is_written_later(
    log: AuditLog, tmp_path: Path, trouble: Trouble
) -> None:
    obstacle = tmp_path / "audit"
    obstacle.touch()
    log.start(trouble.receive)
    log.put(record(1))
    trouble.until(1)
    log.put(record(2))
    obstacle.unlink()
    trouble.until(2)
    assert log.close(within_s=PATIENCE_S)

    assert trouble.reported[0].startswith(str(obstacle))
    assert trouble.reported[1:] == [""]
    assert [entry["seq"] for entry in entries(obstacle)] == [1, 2]


def test_entries_that_are_too_many_are_counted(
    log: AuditLog, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, trouble: Trouble
) -> None:
    monkeypatch.setattr(audit_log, "MOST_WAITING", 3)
    for seq in range(5):
        log.put(record(seq))
    log.start(trouble.receive)
    assert log.close(within_s=PATIENCE_S)

    reported = entries(tmp_path / "audit")
    assert [entry.get("seq") for entry in reported] == [0, 1, 2, None]
    assert reported[-1]["code"] == "entries_lost"
    assert reported[-1]["text"].startswith("2 entries")
