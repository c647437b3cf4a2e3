"""What is stored of the clock for the next run, and what is published of its steps."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from gateway.app.state_files import CLOCK_FILE, SAVE_EVERY_S, ClockMemory
from gateway.records import Severity
from gateway.storage.json_file import JsonFile
from gateway.system.clock import ClockWatch
from gateway.system.clock_steps import ClockReading
from tests.starters.rig import virtually

Event = tuple[str, Severity, str]


class Documents:
    """A memory that counts."""

    def __init__(self) -> None:
        self.saved: list[Mapping[str, Any]] = []

    def load(self) -> Mapping[str, Any] | None:
        return self.saved[-1] if self.saved else None

    def set_aside(self) -> None:
        raise AssertionError("nothing is damaged here")

    async def save(self, document: Mapping[str, Any]) -> None:
        self.saved.append(document)


class Wall:
    """A wall clock that can be set."""

    def __init__(self) -> None:
        self.epoch_s = 1.8e9

    def read(self) -> ClockReading:
        now_s = asyncio.get_running_loop().time()
        return ClockReading(now_s, self.epoch_s + now_s, "boot-1")


def run_of(wall: Wall, memory: Documents, events: list[Event]) -> tuple[ClockWatch, ClockMemory]:
    watch = ClockWatch("trusted", ask=lambda: True, read=wall.read)
    return watch, ClockMemory(watch, memory, publish_event=lambda *event: events.append(event))


@virtually
async def test_a_step_is_published_and_stored_at_once_and_so_is_its_end() -> None:
    wall, memory, events = Wall(), Documents(), list[Event]()
    watch, clock_memory = run_of(wall, memory, events)
    keeping = asyncio.create_task(clock_memory.run())
    await asyncio.sleep(1.0)

    wall.epoch_s -= 20.0
    watch.look()
    await asyncio.sleep(1.0)
    stepped = [*events], [each["doubt"] for each in memory.saved]
    for _ in range(300):
        watch.look()
        await asyncio.sleep(0.25)
    keeping.cancel()

    text = "this gateway's clock was set back by 20.0 s"
    assert [(code, severity) for code, severity, _ in stepped[0]] == [("clock_stepped", Severity.WARNING)]
    assert stepped[0][0][2].startswith(f"{text}: issued_at does not count")
    assert stepped[1] == [None, text]
    assert [code for code, _, _ in events] == ["clock_stepped", "clock_trusted"]
    assert memory.saved[-1]["doubt"] is None


@virtually
async def test_the_next_run_knows_where_the_clock_was() -> None:
    wall, memory, events = Wall(), Documents(), list[Event]()
    _, clock_memory = run_of(wall, memory, events)
    await clock_memory.close()

    wall.epoch_s += 9 * 86400.0
    watch, clock_memory = run_of(wall, memory, events)
    keeping = asyncio.create_task(clock_memory.run())
    await asyncio.sleep(1.0)
    keeping.cancel()

    assert watch.step == "this gateway's clock was set ahead by 777600.0 s between two runs"
    assert [code for code, _, _ in events] == ["clock_stepped"]
    assert memory.saved[-1]["doubt"] == watch.step  # a third run is warned too


@virtually
async def test_a_quiet_clock_is_stored_every_ten_minutes() -> None:
    wall, memory, events = Wall(), Documents(), list[Event]()
    _, clock_memory = run_of(wall, memory, events)
    keeping = asyncio.create_task(clock_memory.run())
    await asyncio.sleep(3 * SAVE_EVERY_S + 1.0)
    keeping.cancel()

    assert len(memory.saved) == 4
    assert events == []


@pytest.mark.parametrize("content", ["", "[]", "{nonsense"])
async def test_a_damaged_file_is_put_aside_and_the_clock_counts_as_configured(
    content: str, tmp_path: Path
) -> None:
    (tmp_path / CLOCK_FILE).write_text(content, "utf-8")
    watch = ClockWatch("trusted")

    ClockMemory(watch, JsonFile(tmp_path / CLOCK_FILE), publish_event=lambda *_: None)

    assert watch.doubt() is None
    assert (tmp_path / f"{CLOCK_FILE}.damaged").exists()
