"""A reload that fails by a bug, and the memory of the starters that reloads replace."""

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
from gateway.contract import Event, event_of
from tests.config.sites import site


@pytest.fixture(autouse=True)
def _collector() -> Iterator[None]:
    yield
    gc.unfreeze()


@dataclass
class World:
    """Stands for the file, the gateway and systemd."""

    trouble: Exception | None = None
    replaced: int = 0
    changed: list[Site] = field(default_factory=list)
    reported: list[str] = field(default_factory=list)
    is_over: asyncio.Event = field(default_factory=asyncio.Event)

    def read(self) -> Site:
        assert threading.current_thread() is not threading.main_thread()
        return Site.of(site(), folder=Path("/etc"), password="secret")

    # App, as far as a reload calls it
    async def change(self, site: Site) -> int:
        if self.trouble is not None:
            raise self.trouble
        self.changed.append(site)
        return self.replaced

    def publish_event(self, *event: Any, **fields: Any) -> None:
        said = event[0] if isinstance(event[0], Event) else event_of(*event, **fields)
        self.reported.append(said.code)

    # Notifier
    def reloading(self) -> None:
        self.is_over.clear()

    def ready(self, status: str) -> None:
        self.is_over.set()

    async def reload(self, reload: Reload) -> None:
        """Reload, and wait until systemd was notified that it is over."""
        self.is_over.clear()
        reload.begin()
        async with asyncio.timeout(10.0):
            await self.is_over.wait()


async def test_a_bug_is_reported_and_the_next_reload_tries_again(caplog: pytest.LogCaptureFixture) -> None:
    world: Any = World(trouble=RuntimeError("bug"))
    reload = Reload(world.read, world, world)

    await world.reload(reload)
    world.trouble = None
    await world.reload(reload)

    assert world.reported == ["reload_failed"]
    assert "bug" in caplog.text
    assert len(world.changed) == 1


async def test_the_memory_of_starters_that_are_gone_is_cleared_only_now_and_then(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    collections: list[int] = []
    monkeypatch.setattr(gc, "collect", lambda: collections.append(1))
    world: Any = World(replaced=MOST_REMAINS // 4)
    reload = Reload(world.read, world, world)

    counts = []
    for _ in range(8):
        await world.reload(reload)
        counts.append(len(collections))

    assert counts == [0, 0, 0, 1, 1, 1, 1, 2]
