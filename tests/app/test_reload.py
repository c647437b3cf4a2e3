"""What a request to read the configuration again does: off the loop, one at a time, with notices."""

from __future__ import annotations

import asyncio
import gc
import threading
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from gateway.app.gateway import MOST_REMAINS, Reload
from gateway.app.site import Site
from gateway.contract import Event, Severity, event_of
from gateway.errors import ConfigError, Problem
from tests.config.sites import site


@pytest.fixture(autouse=True)
def _collector() -> Iterator[None]:
    yield
    gc.unfreeze()


@dataclass
class World:
    """Stands for the file, the gateway and systemd."""

    mistakes: list[Problem] = field(default_factory=list)
    trouble: Exception | None = None
    replaced: int = 0
    reads: int = 0
    changed: list[Site] = field(default_factory=list)
    reported: list[tuple[str, Severity, str, dict[str, list[str]]]] = field(default_factory=list)
    systemd: list[str] = field(default_factory=list)
    gate: threading.Event = field(default_factory=threading.Event)
    is_read: threading.Event = field(default_factory=threading.Event)
    over: asyncio.Event = field(default_factory=asyncio.Event)

    def read(self) -> Site:
        assert threading.current_thread() is not threading.main_thread()
        self.reads += 1
        self.is_read.set()
        assert self.gate.wait(10.0)
        if self.mistakes:
            raise ConfigError("site.toml", self.mistakes)
        return Site.of(site(), folder=Path("/etc"), password="secret")

    # App, as far as a reload calls it
    async def change(self, site: Site) -> int:
        if self.trouble is not None:
            raise self.trouble
        self.changed.append(site)
        return self.replaced

    def publish_event(self, *event: Any, **fields: Any) -> None:
        said = event[0] if isinstance(event[0], Event) else event_of(*event, **fields)
        self.reported.append((said.code, said.severity, said.text, said.data))

    # Notifier
    def reloading(self) -> None:
        self.systemd.append("reloading")

    def ready(self, status: str) -> None:
        self.systemd.append(f"ready: {status}")
        self.over.set()

    def reload(self) -> Reload:
        notifier: Any = self
        return Reload(self.read, self, notifier)

    async def done(self, count: int = 1) -> None:
        """Wait until systemd was notified that so many reloads are over."""
        async with asyncio.timeout(10.0):
            while sum(said.startswith("ready") for said in self.systemd) < count:
                self.over.clear()
                await self.over.wait()

    async def begun(self) -> None:
        """Wait until the file is being read."""
        assert await asyncio.to_thread(self.is_read.wait, 10.0)


@pytest.fixture
def world() -> World:
    return World()


async def test_a_bug_is_reported_and_the_next_reload_tries_again(
    world: World, caplog: pytest.LogCaptureFixture
) -> None:
    world.trouble = RuntimeError("bug")
    world.gate.set()
    reload = world.reload()

    reload.begin()
    await world.done()
    world.trouble = None
    reload.begin()
    await world.done(2)

    assert [code for code, *_ in world.reported] == ["reload_failed"]
    assert "bug" in caplog.text
    assert len(world.changed) == 1


async def test_the_memory_of_starters_that_are_gone_is_cleared_only_now_and_then(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    collections: list[int] = []
    monkeypatch.setattr(gc, "collect", lambda: collections.append(1))
    world.replaced = MOST_REMAINS // 4
    world.gate.set()
    reload = world.reload()

    counts = []
    for number in range(8):
        reload.begin()
        await world.done(number + 1)
        counts.append(len(collections))

    assert counts == [0, 0, 0, 1, 1, 1, 1, 2]
