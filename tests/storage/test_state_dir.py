"""What a gateway keeps, put together; on real files."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from gateway.records import Phase, ResultRecord, Severity
from gateway.storage.audit.chain import read_line
from gateway.storage.audit.segments import lines
from gateway.storage.journal import Remembered
from gateway.storage.state_dir import FILE, StateDir
from gateway.system.clock import SystemClock

PATIENCE_S = 10.0
RESULT = ResultRecord("pump-1", "alice", "1", "start", Phase.CONFIRMED, "ok", "", 5.0)


class Gateway:
    """What a state directory is connected to."""

    def __init__(self, state_dir: Path, *, is_read_only: bool = False) -> None:
        self.events: list[tuple[str, Severity]] = []
        self.recalled: list[Remembered] | None = None
        self._changed = asyncio.Event()
        self.state_dir = StateDir(
            state_dir,
            boot="boot-1",
            clock=SystemClock(),
            hold_s=0.0,
            is_read_only=is_read_only,
            publish_event=self._publish_event,
            retry_s=0.02,
        )

    async def until(self, is_true: Callable[[], bool]) -> None:
        async with asyncio.timeout(PATIENCE_S):
            while not is_true():
                self._changed.clear()
                await self._changed.wait()

    async def begin(self) -> Gateway:
        self.state_dir.start("9.9", on_recalled=self._recall)
        await self.until(lambda: self.recalled is not None)
        return self

    def codes(self) -> list[str]:
        return [code for code, _ in self.events]

    def _publish_event(self, code: str, severity: Severity, text: str) -> None:
        self.events.append((code, severity))
        self._changed.set()

    def _recall(self, commands: Sequence[Remembered]) -> None:
        self.recalled = list(commands)
        self._changed.set()


def said(state_dir: Path) -> list[str]:
    return [read_line(line)[0]["code"] for _, line in lines(state_dir / "audit")]


@pytest.mark.parametrize(("is_read_only", "severity"), [(False, Severity.ERROR), (True, Severity.WARNING)])
async def test_a_state_directory_that_cannot_be_made_is_reported_and_recovers(
    tmp_path: Path, is_read_only: bool, severity: Severity
) -> None:
    obstacle = tmp_path / "state"
    obstacle.touch()
    gateway = Gateway(obstacle, is_read_only=is_read_only)
    gateway.state_dir.start("9.9", on_recalled=gateway._recall)
    await gateway.until(lambda: len(gateway.events) == 2)
    reported = sorted(gateway.events)
    assert gateway.state_dir.journal.trouble
    obstacle.unlink()
    await gateway.until(lambda: len(gateway.events) == 4)
    await gateway.until(lambda: not gateway.state_dir.journal.trouble)
    await gateway.state_dir.close("over")

    assert reported == [("audit_unavailable", severity), ("ledger_unavailable", severity)]
    assert sorted(gateway.codes()[2:]) == ["audit_available", "ledger_available"]
    assert said(obstacle) == ["gateway_started", "gateway_ended"]


async def test_a_lost_ledger_is_reported(tmp_path: Path) -> None:
    corrupt(tmp_path)

    gateway = await Gateway(tmp_path).begin()
    await gateway.state_dir.close("over")

    assert gateway.codes() == ["ledger_lost"]


async def test_a_slow_disk_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gateway.storage.ledger.INTEND_WITHIN_S", 0.0)
    gateway = await Gateway(tmp_path).begin()

    with pytest.raises(Exception, match="ledger_unavailable"):
        await gateway.state_dir.journal.intend(RESULT)
    await gateway.state_dir.close("over")

    assert gateway.codes() == ["ledger_slow"]


def corrupt(state_dir: Path) -> None:
    (state_dir / FILE).write_text("nonsense " * 100)
