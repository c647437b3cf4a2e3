from __future__ import annotations

import asyncio
import json
import logging
import socket
import stat
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from gateway.app import capture_socket
from gateway.app.capture_socket import CaptureSocket
from gateway.line.events import OnFrame
from gateway.system.clock_steps import ClockReading
from tests.virtual_time import EPOCH_S

LONG_S = 10.0


class Clock:
    def now_s(self) -> float:
        return 0.0

    def utc_s(self, at_s: float | None = None) -> float:
        return EPOCH_S + (at_s or 0.0)

    def reading(self) -> ClockReading:
        return ClockReading(0.0, EPOCH_S)


class Lines:
    """What the socket asks of the lines."""

    def __init__(self) -> None:
        self.on_frame: OnFrame | None = None
        self.turned = asyncio.Event()

    def capture(self, on_frame: OnFrame | None) -> None:
        self.on_frame = on_frame
        self.turned.set()

    async def step(self) -> None:
        await asyncio.wait_for(self.turned.wait(), LONG_S)
        self.turned.clear()


@asynccontextmanager
async def serving(path: Path) -> AsyncIterator[tuple[Lines, asyncio.Task[None]]]:
    lines = Lines()
    offered = CaptureSocket(path, ["pumps", "fans"], lines.capture, Clock())
    task = asyncio.create_task(offered.run())
    await asyncio.sleep(0)
    yield lines, task
    task.cancel()
    await asyncio.wait([task])


async def connect(path: Path) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
    return await asyncio.open_unix_connection(str(path))


async def test_frames_are_reported_with_their_time_while_somebody_reads(tmp_path: Path) -> None:
    async with serving(tmp_path / "c") as (lines, _):
        reader, writer = await connect(tmp_path / "c")
        assert json.loads(await reader.readline()) == {"capture": 1, "lines": ["pumps", "fans"]}
        await lines.step()
        assert lines.on_frame is not None

        lines.on_frame("pumps", 1.000002, ">>", b"\x01\x03")
        assert json.loads(await reader.readline()) == {
            "line": "pumps",
            "time_us": round(EPOCH_S * 1e6) + 1_000_002,
            "direction": ">>",
            "frame": "0103",
        }

        writer.close()
        await lines.step()
        assert lines.on_frame is None


async def test_only_the_gateways_user_may_connect_and_nothing_is_left_behind(tmp_path: Path) -> None:
    path = tmp_path / "c"
    async with serving(path):
        assert stat.S_IMODE(path.stat().st_mode) == 0o600

    assert not path.exists()


async def test_what_a_killed_gateway_left_there_is_replaced(tmp_path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as left:
        left.bind(str(tmp_path / "c"))

    async with serving(tmp_path / "c") as (lines, _):
        reader, writer = await connect(tmp_path / "c")
        assert await reader.readline()
        await lines.step()
        writer.close()


async def test_a_reader_that_is_too_slow_is_cut_off(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(capture_socket, "MOST_UNSENT_BYTES", 10_000)
    caplog.set_level(logging.WARNING)
    async with serving(tmp_path / "c") as (lines, _):
        _, writer = await connect(tmp_path / "c")
        await lines.step()
        on_frame = lines.on_frame
        assert on_frame is not None

        for _ in range(5000):
            on_frame("pumps", 0.0, ">>", bytes(256))
            if caplog.text:
                break
        await lines.step()
        writer.close()

    assert "too slow" in caplog.text
