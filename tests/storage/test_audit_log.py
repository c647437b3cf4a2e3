from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from gateway.contract import AuditRecord
from gateway.storage.audit import log as audit_log
from gateway.storage.audit.chain import read_line
from gateway.storage.audit.log import AuditLog
from gateway.storage.audit.segments import lines


def record(seq: int, args: dict[str, Any]) -> AuditRecord:
    return AuditRecord(
        starter="pump-1",
        client="alice",
        operator=None,
        verb="set",
        args=args,
        decision="confirmed",
        code="ok",
        time_s=1_760_000_000.0,
        seq=seq,
    )


def written(folder: Path, *records: AuditRecord) -> list[dict[str, Any]]:
    """Return the entries of a log that had these records while it was not yet started."""
    log = AuditLog(folder, boot="boot-1", retry_s=0.02)
    for each in records:
        log.put(each)
    log.start(lambda _: None)
    assert log.close(within_s=10.0)
    return [read_line(line)[0] for _, line in lines(folder)]


def test_entries_that_are_too_many_are_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(audit_log, "MOST_WAITING", 3)

    entries = written(tmp_path / "audit", *(record(seq, {}) for seq in range(5)))

    assert [entry.get("seq") for entry in entries] == [0, 1, 2, None]
    assert entries[-1]["code"] == "entries_lost"
    assert entries[-1]["text"].startswith("2 entries")


def test_an_entry_that_cannot_be_written_at_all_is_counted(tmp_path: Path) -> None:
    endless: dict[str, Any] = {}
    endless["again"] = endless

    assert [entry["code"] for entry in written(tmp_path / "audit", record(1, endless))] == ["entries_lost"]
