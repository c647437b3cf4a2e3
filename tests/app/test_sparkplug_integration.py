"""Sparkplug beside everything else: followed by a reload, made anew by other settings, gone by itself."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

from gateway.app.integrations.integration import IntegrationHost
from gateway.app.integrations.sparkplug import SparkplugService, sparkplug_integration
from gateway.app.site import Site
from gateway.records import Record
from tests.sparkplug.sites import site
from tests.sparkplug.support import availability
from tests.virtual_time import VirtualClock, run_virtually


class FakeNode:
    """Stands for the edge node's connection."""

    def __init__(self, settings: Any, names: tuple[Any, ...]) -> None:
        self.settings, self.log = settings, [names]
        self.is_ended = False

    def put(self, record: Record) -> None:
        raise ValueError("ordered")

    def follow(self, starters: tuple[str, ...], lines: tuple[str, ...]) -> None:
        self.log.append((starters, lines))

    async def run(self) -> None:
        try:
            await asyncio.sleep(1e6)
        finally:
            self.is_ended = True


class FakeModule:
    """Stands for `gateway.sparkplug.service`."""

    def __init__(self) -> None:
        self.nodes: list[FakeNode] = []

    def sparkplug_link(self, settings: Any, _: Any, *, starters: Any, lines: Any, **_more: Any) -> FakeNode:
        self.nodes.append(FakeNode(settings, (starters, lines)))
        return self.nodes[-1]


def test_a_reload_changes_the_node_and_other_settings_make_it_anew(tmp_path: Path) -> None:
    async def scenario() -> None:
        module = FakeModule()
        first = site(tmp_path, '[sparkplug]\ngroup = "plant"\n')
        service = SparkplugService(first, module, None, seed=1)  # type: ignore[arg-type]  # parts: not used
        serving = asyncio.create_task(service.run())
        await asyncio.sleep(1.0)

        service.move(site(tmp_path, '[sparkplug]\ngroup = "plant"\n'))
        assert module.nodes[0].log == [(("pump",), ("hall",))] * 2
        service.move(site(tmp_path, '[sparkplug]\ngroup = "other"\n'))
        await asyncio.sleep(1.0)

        assert module.nodes[0].is_ended
        assert [each.settings.group for each in module.nodes] == ["plant", "other"]
        serving.cancel()
        await asyncio.gather(serving, return_exceptions=True)
        assert module.nodes[1].is_ended

    run_virtually(scenario())


async def test_a_fault_on_order_ends_the_node_alone_and_it_begins_anew(
    tmp_path: Path, monkeypatch: Any
) -> None:
    events: list[str] = []
    read: Site = site(tmp_path, '[sparkplug]\ngroup = "plant"\nurls = ["mqtt://127.0.0.1:9"]\n')
    integration = sparkplug_integration(
        IntegrationHost(
            read,
            VirtualClock(asyncio.get_running_loop()),
            lambda: True,
            lambda code, *_: events.append(code),
        ),
        latest=tuple,
        take=lambda _: None,
        reject=lambda _: None,
        facts=dict,
        since_s=0.0,
    )
    serving = asyncio.create_task(integration.run())
    async with asyncio.timeout(20.0):
        while integration.service is None:  # noqa: ASYNC110 - a thread imports it
            await asyncio.sleep(0.01)
    monkeypatch.setattr("gateway.sparkplug.node.EdgeNode.put", lambda *_, **__: 1 / 0)

    integration.put(availability("pump", "online", 1.0))

    assert integration.service is None
    serving.cancel()
    await asyncio.gather(serving, return_exceptions=True)
